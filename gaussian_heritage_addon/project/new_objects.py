"""Objects that are new in a scene are selected and framed, and their boxes flash."""

from __future__ import annotations

from collections.abc import Collection

import bpy

from ..splats.properties import apply_visibility
from ..splats.selection import heritage_objects, select_object
from ..splats.solid_mode import viewports
from ..splats.splat_boxes import flash, frame


def show_new_objects(scene: bpy.types.Scene, ids: list[str], *, known: Collection[str] = ()) -> None:
    """Show the objects `ids` of `scene`, the best first, as new.

    The background that comes with other objects is hidden, also where it was there before: it surrounds them. Objects
    found without a prompt fill the room, so the view stays. The others of `known` were there before and have only
    changed: where all are, what is selected, the eyes and the view stay as they are, since the user may work on
    something else meanwhile.
    """
    present = {obj.heritage.object_id: obj for obj in heritage_objects(scene, "OBJECT")}
    new = [present[one] for one in ids if one in present and one not in known]
    objects = [obj for obj in new if obj.heritage.kind != "background"]
    for obj in new:
        obj.heritage.hidden = False
    if objects:
        for one in ids:
            if one in present and present[one].heritage.kind == "background":
                present[one].heritage.hidden = True
    apply_visibility(scene)
    shown = objects or new
    if not shown:
        if not bpy.app.background:
            flash([present[one] for one in ids if one in present])
        return
    select_object(scene, shown[0].heritage.object_id)
    _select(scene, shown)
    if bpy.app.background:
        return
    flash(shown)
    if any(obj.heritage.kind == "all" for obj in shown):
        return
    for area in viewports(scene):
        frame(area.spaces.active.region_3d, shown, scene.camera)


def show_imported(scene: bpy.types.Scene, obj: bpy.types.Object) -> None:
    """Select and frame splats that were imported from a file."""
    _select(scene, [obj])
    if bpy.app.background:
        return
    for area in viewports(scene):
        frame(area.spaces.active.region_3d, [obj], scene.camera)


def _select(scene: bpy.types.Scene, objects: list[bpy.types.Object]) -> None:
    """Select these objects and no others; the first is active."""
    layer = bpy.context.view_layer if bpy.context.scene == scene else scene.view_layers[0]
    layer.update()
    in_layer = [obj for obj in objects if obj.name in layer.objects]
    for obj in layer.objects:
        obj.select_set(obj in in_layer, view_layer=layer)
    if in_layer:
        layer.objects.active = in_layer[0]
