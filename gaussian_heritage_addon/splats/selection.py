"""The one selection of splat objects: the row of the list is the object that is active and selected in Blender."""

from __future__ import annotations

import bpy

from ...engine.core.errors import ObjectError
from .splats import SplatScene


def heritage_objects(scene: bpy.types.Scene, role: str | None = None) -> list[bpy.types.Object]:
    """Return the splat objects of `scene` with the `role` ``"SCENE"`` or ``"OBJECT"``, by default with either."""
    roles = {role} if role else {"SCENE", "OBJECT"}
    return [obj for obj in scene.objects if obj.heritage.role in roles]


def view_layer_of(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """Return the view layer in which `scene` is shown, or else its first one."""
    shown = bpy.context.view_layer
    return shown if shown is not None and shown.id_data == scene else scene.view_layers[0]


def active_object(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return the isolated object that is selected, in the panel's list as in Blender, or None.

    It is Blender's active object where that is selected too, or is not shown and so cannot be. While splats are in Edit
    Mode, which Blender's active object cannot leave, it is the object of the list that the edits are meant for.
    """
    layer = view_layer_of(scene)
    obj = layer.objects.active
    if obj is not None and obj.mode == "EDIT" and SplatScene.is_splats(obj):
        return _remembered(scene)
    if obj is None or obj.heritage.role != "OBJECT":
        return None
    return obj if obj.select_get(view_layer=layer) or not obj.visible_get(view_layer=layer) else None


def _remembered(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return the isolated object that was selected last."""
    wanted = scene.heritage
    if not wanted.active_name:
        return None
    found = [obj for obj in heritage_objects(scene, "OBJECT") if obj.heritage.object_id == wanted.active_id]
    # A copy has the same id; an object that was renamed has another name.
    return next((obj for obj in found if obj.name == wanted.active_name), found[0] if found else None)


def _remember(scene: bpy.types.Scene, obj: bpy.types.Object | None) -> None:
    name, object_id = ("", "") if obj is None else (obj.name, obj.heritage.object_id)
    if (scene.heritage.active_name, scene.heritage.active_id) != (name, object_id):
        scene.heritage.active_name, scene.heritage.active_id = name, object_id


_followed: dict[str, tuple[str, tuple[str, ...]]] = {}
"""By name of a scene: the names of its active object and of those selected at the last change."""


def follow_selection(scene: bpy.types.Scene) -> None:
    """Make the only object that was selected the active one, and remember it for the time in Edit Mode.

    Blender's box, lasso and circle select objects without making one of them active. What a script makes active stays.
    """
    layer = view_layer_of(scene)
    active = layer.objects.active
    selected = [obj for obj in layer.objects if obj.select_get(view_layer=layer)]
    now = "" if active is None else active.name, tuple(obj.name for obj in selected)
    before = _followed.get(scene.name, now)
    _followed[scene.name] = now
    was_selected = before[0] == now[0] and before[1] != now[1]
    is_apart = active is None or (active.mode == "OBJECT" and active not in selected)
    if was_selected and is_apart and len(selected) == 1 and selected[0].heritage.role == "OBJECT":
        layer.objects.active = selected[0]
    obj = active_object(scene)
    if obj is not None:
        _remember(scene, obj)


def set_active_object(scene: bpy.types.Scene, obj: bpy.types.Object | None) -> None:
    """Select `obj` alone, in the panel's list and in Blender; no isolated object where `obj` is none of `scene`.

    Raises
    ------
    ObjectError
        When the object is in a collection that the view layer leaves out.
    """
    layer = view_layer_of(scene)
    known = obj if obj in heritage_objects(scene, "OBJECT") else None
    active = layer.objects.active
    if active is None or active.mode != "EDIT":
        if known is not None and layer.objects.get(known.name) != known:
            raise ObjectError(
                f"{known.name} is in a collection that this view layer leaves out. Tick it in the outliner first."
            )
        for other in layer.objects:
            if known is not None or other.heritage.role == "OBJECT":
                # What is not shown cannot be selected.
                other.select_set(other == known and known.visible_get(view_layer=layer), view_layer=layer)
        if known is not None or (active is not None and active.heritage.role == "OBJECT"):
            layer.objects.active = known
    _remember(scene, known)


def select_object(scene: bpy.types.Scene, object_id: str) -> None:
    """Select the isolated object `object_id` in the panel's list."""
    for obj in heritage_objects(scene, "OBJECT"):
        if obj.heritage.object_id == object_id:
            set_active_object(scene, obj)
