"""What the add-on stores in the .blend file: on the scene, and on each splat object."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..engine.errors import HeritageError
from ..engine.records import MuseumRecord, save_record
from .splat_nodes import AS_TRAINED, THRESHOLD, set_display_input

__all__ = ["CLASSES", "heritage_objects", "record_of", "register", "unregister"]


def heritage_objects(scene: bpy.types.Scene, role: str | None = None) -> list[bpy.types.Object]:
    """Return the splat objects of `scene` with the `role` ``"SCENE"`` or ``"OBJECT"``, or with either."""
    roles = {role} if role else {"SCENE", "OBJECT"}
    return [obj for obj in scene.objects if obj.heritage.role in roles]


def record_of(obj: bpy.types.Object) -> MuseumRecord:
    """Return what the museum says about `obj`."""
    said = obj.heritage
    return MuseumRecord(said.catalogue_number, said.title, said.rights, said.notes)


def _threshold_changed(said: Any, context: bpy.types.Context) -> None:
    set_display_input(said.id_data, THRESHOLD, said.threshold)


def _record_changed(said: Any, context: bpy.types.Context) -> None:
    # The .blend keeps the record in any case; the project's copy is for the engine's exports.
    if not said.project or not said.object_id or said.is_loading:
        return
    try:
        save_record(Path(said.project), said.object_id, record_of(said.id_data))
    except HeritageError as error:
        said.record_problem = str(error)
    else:
        said.record_problem = ""


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
        name="Prompt", description="What to isolate, in words"
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
    catalogue_number: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Catalogue Number", update=_record_changed
    )
    title: bpy.props.StringProperty(name="Title", update=_record_changed)  # type: ignore[valid-type]
    rights: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Rights", description="Credit line, licence or rights statement", update=_record_changed
    )
    notes: bpy.props.StringProperty(name="Notes", update=_record_changed)  # type: ignore[valid-type]
    record_problem: bpy.props.StringProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]
    is_loading: bpy.props.BoolProperty(options={"SKIP_SAVE", "HIDDEN"})  # type: ignore[valid-type]


CLASSES = [HeritageScene, HeritageObject]


def register() -> None:
    """Put the groups on scenes and objects; their classes are registered already."""
    bpy.types.Scene.heritage = bpy.props.PointerProperty(type=HeritageScene)
    bpy.types.Object.heritage = bpy.props.PointerProperty(type=HeritageObject)


def unregister() -> None:
    """Take them away again."""
    del bpy.types.Object.heritage
    del bpy.types.Scene.heritage
