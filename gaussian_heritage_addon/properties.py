"""What the add-on stores in the .blend file: on the scene, and on each splat object."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..engine.errors import HeritageError
from ..engine.records import MuseumRecord, save_record
from .project import load_level
from .splat_nodes import AS_TRAINED, THRESHOLD, set_display_input
from .splats import SplatScene

__all__ = [
    "CLASSES",
    "active_object",
    "apply_blending",
    "choose",
    "heritage_objects",
    "record_of",
    "register",
    "show_parts",
    "unregister",
]


def heritage_objects(scene: bpy.types.Scene, role: str | None = None) -> list[bpy.types.Object]:
    """Return the splat objects of `scene` with the `role` ``"SCENE"`` or ``"OBJECT"``, or with either."""
    roles = {role} if role else {"SCENE", "OBJECT"}
    return [obj for obj in scene.objects if obj.heritage.role in roles]


def active_object(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return the isolated object chosen in the panel's list; None when there is none."""
    number = scene.heritage.active
    obj = bpy.data.objects[number] if 0 <= number < len(bpy.data.objects) else None
    return obj if obj is not None and obj in heritage_objects(scene, "OBJECT") else None


def choose(scene: bpy.types.Scene, object_id: str) -> None:
    """Make the isolated object `object_id` the one chosen in the panel's list."""
    for obj in heritage_objects(scene, "OBJECT"):
        if obj.heritage.object_id == object_id:
            scene.heritage.active = bpy.data.objects.find(obj.name)


def record_of(obj: bpy.types.Object) -> MuseumRecord:
    """Return what the museum says about `obj`."""
    said = obj.heritage
    return MuseumRecord(said.catalogue_number, said.title, said.rights, said.notes)


def _threshold_changed(said: Any, context: bpy.types.Context) -> None:
    set_display_input(said.id_data, THRESHOLD, said.threshold)


def _level_changed(said: Any, context: bpy.types.Context) -> None:
    if said.is_loading:
        return
    try:
        show_level(said.id_data)
    except HeritageError as error:
        said.problem = str(error)
    else:
        said.problem = ""


def _part_to_whole(said: Any) -> float:
    return said.level / max(1, said.n_levels - 1)


def _set_part_to_whole(said: Any, value: float) -> None:
    level = round(value * (said.n_levels - 1))
    # A drag calls this at every pixel; the Gaussians change with the level only.
    if level != said.level:
        said.level = level


def show_level(obj: bpy.types.Object) -> None:
    """Give the Gaussians of `obj` their membership at its level, straight from the project.

    Raises
    ------
    HeritageError
        When the project no longer holds that level, or the object is in Edit Mode.
    """
    said, splats = obj.heritage, SplatScene.of(obj)
    if (said.level, said.n_levels) == (0, 1):
        return
    membership = load_level(Path(said.project), said.object_id, said.level, obj["heritage_count"])
    index = splats.index
    splats.set_membership(np.where(index >= 0, membership[index], 0.0).astype(np.float32))


def _record_changed(said: Any, context: bpy.types.Context) -> None:
    # The .blend keeps the record in any case; the project's copy is for the engine's exports.
    if not said.project or not said.object_id or said.is_loading:
        return
    try:
        save_record(Path(said.project), said.object_id, record_of(said.id_data))
    except HeritageError as error:
        said.problem = str(error)
    else:
        said.problem = ""


def show_parts(scene: bpy.types.Scene) -> None:
    """Show the whole scene or its objects: both at once would draw their Gaussians twice."""
    for obj in heritage_objects(scene):
        hidden = obj.heritage.role != {"SCENE": "SCENE", "OBJECTS": "OBJECT"}[scene.heritage.show]
        obj.hide_render = obj.hide_viewport = hidden


def apply_blending(scene: bpy.types.Scene) -> None:
    """Give all splats of `scene` its way of blending, and the view transform that goes with it."""
    as_trained = scene.heritage.blending == "TRAINED"
    for obj in heritage_objects(scene):
        set_display_input(obj, AS_TRAINED, as_trained)
    scene.view_settings.view_transform = "Raw" if as_trained else "Standard"


def _photo_opacity_changed(said: Any, context: bpy.types.Context) -> None:
    for obj in said.id_data.objects:
        if obj.type == "CAMERA" and "heritage_photo" in obj:
            for entry in obj.data.background_images:
                entry.alpha = said.photo_opacity


# Blender evaluates the annotations below as text: they can name functions, but a lambda there would lose this module.
def _show_changed(said: Any, context: bpy.types.Context) -> None:
    show_parts(said.id_data)


def _blending_changed(said: Any, context: bpy.types.Context) -> None:
    apply_blending(said.id_data)


class HeritageScene(bpy.types.PropertyGroup):
    """What belongs to a scene."""

    project: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Project", description="Project folder of this scene", subtype="DIR_PATH"
    )
    prompt: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Prompt", description='What to isolate, in words; several things as "vase;teapot"'
    )
    photo_opacity: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Photo",
        description="Over the splats, where a photo is clicked through its camera",
        min=0.0,
        max=1.0,
        default=1.0,
        subtype="FACTOR",
        update=_photo_opacity_changed,
    )
    active: bpy.props.IntProperty(name="Active Object")  # type: ignore[valid-type]
    show: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Show",
        items=[
            ("SCENE", "Scene", "The whole scene"),
            ("OBJECTS", "Objects", "The isolated objects"),
        ],
        update=_show_changed,
    )
    blending: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Blending",
        items=[
            ("LINEAR", "Linear", "Blend light, as other objects in Blender do; view transform Standard"),
            ("TRAINED", "As Trained", "Blend sRGB values, as the scene was trained on photos; view transform Raw"),
        ],
        update=_blending_changed,
    )


class HeritageObject(bpy.types.PropertyGroup):
    """What belongs to a splat object."""

    role: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Role",
        items=[("NONE", "None", ""), ("SCENE", "Scene", "A whole scene"), ("OBJECT", "Object", "An isolated object")],
    )
    project: bpy.props.StringProperty(name="Project", subtype="DIR_PATH")  # type: ignore[valid-type]
    object_id: bpy.props.StringProperty(name="Object Id")  # type: ignore[valid-type]
    prompt: bpy.props.StringProperty(name="Prompt")  # type: ignore[valid-type]
    score: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Confidence", description="That this is what was asked for, 0 to 1"
    )
    threshold: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Threshold",
        description="Higher is tighter: only Gaussians with at least this membership belong to the object",
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        update=_threshold_changed,
    )
    kind: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Kind", description="How it was asked for: text, click, all, background"
    )
    level: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Level", description="0 is the smallest part", min=0, update=_level_changed
    )
    n_levels: bpy.props.IntProperty(name="Levels", min=1, default=1)  # type: ignore[valid-type]
    stored_level: bpy.props.IntProperty(name="Level in the Project", min=0)  # type: ignore[valid-type]
    part_to_whole: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Part to Whole",
        description="From the smallest part that was clicked or named to the whole it belongs to",
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        get=_part_to_whole,
        set=_set_part_to_whole,
    )
    catalogue_number: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Catalogue Number", update=_record_changed
    )
    title: bpy.props.StringProperty(name="Title", update=_record_changed)  # type: ignore[valid-type]
    rights: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Rights", description="Credit line, licence or rights statement", update=_record_changed
    )
    notes: bpy.props.StringProperty(name="Notes", update=_record_changed)  # type: ignore[valid-type]
    problem: bpy.props.StringProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]
    is_loading: bpy.props.BoolProperty(options={"SKIP_SAVE", "HIDDEN"})  # type: ignore[valid-type]


class HeritageClick(bpy.types.PropertyGroup):
    """A pixel of a photo, for operators."""

    photo: bpy.props.StringProperty(name="Photo")  # type: ignore[valid-type]
    x: bpy.props.FloatProperty(name="X", description="Pixels from the photo's left edge")  # type: ignore[valid-type]
    y: bpy.props.FloatProperty(name="Y", description="Pixels from the photo's upper edge")  # type: ignore[valid-type]
    wanted: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Wanted", description="Off: what lies there is not part of the object", default=True
    )


CLASSES = [HeritageScene, HeritageObject, HeritageClick]


def register() -> None:
    """Put the groups on scenes and objects; their classes are registered already."""
    bpy.types.Scene.heritage = bpy.props.PointerProperty(type=HeritageScene)
    bpy.types.Object.heritage = bpy.props.PointerProperty(type=HeritageObject)


def unregister() -> None:
    """Take them away again."""
    del bpy.types.Object.heritage
    del bpy.types.Scene.heritage
