"""Properties that the add-on stores in the .blend file, on the scene and on each splat object."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from ...engine.core.errors import ObjectError, ProjectError
from ...engine.objects.settings import DEFAULT_THRESHOLD
from ...engine.project.objects import MuseumRecord, load_level
from ..blender.guards import add_property
from ..blender.lengths import read_length, write_length
from ..blender.typed_properties import blender_properties
from .object_meshes import show_meshes
from .selection import (
    active_object,
    heritage_objects,
    set_active_object,
    view_layer_of,
)
from .splat_nodes import AS_TRAINED, THRESHOLD, set_display_input
from .splats import SplatScene

_MAX_SHOWN = 200
"""Characters of a path that are shown."""
PHOTO_KEY = "heritage_photo"
"""Custom property of a camera: the name of its photo."""
COUNT_KEY = "heritage_count"
"""Custom property of a splat object: the number of Gaussians in the project's scene.

It can differ from the number of vertices, since the mesh may have been edited."""
_MAX_SCENE_COUNT = 1 << 26
"""Largest number of Gaussians of a scene: tables of this length are made before its files are read."""


def project_of(properties: HeritageScene | HeritageObject) -> Path:
    """Return the project folder that a .blend file names; paths that begin with ``//`` are relative to that file.

    Raises
    ------
    ProjectError
        When no folder can have that path.
    """
    # Absolute, so that the engine never takes it for an option.
    owner = properties.id_data
    path = Path(os.path.abspath(bpy.path.abspath(properties.project, library=owner.library)))
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        return path
    except OSError as error:
        # A name that no file system accepts fails in other ways wherever it is used.
        raise ProjectError(
            f"The project {str(path)[:_MAX_SHOWN]} cannot be opened: {error.strerror or error}. Open another one."
        ) from error
    return path


@contextlib.contextmanager
def loading(properties: HeritageObject) -> Iterator[None]:
    """Set properties from the project in this block: they are not written to it again, and no level is read."""
    properties.is_loading = True
    try:
        yield
    finally:
        properties.is_loading = False


def photo_of(obj: bpy.types.Object) -> str:
    """Return the name of the photo that the camera `obj` belongs to; empty for any other object."""
    photo = obj.get(PHOTO_KEY) if obj.type == "CAMERA" else None
    return photo if isinstance(photo, str) else ""


def scene_count(obj: bpy.types.Object) -> int:
    """Return the number of Gaussians in the project's scene, as stored on the splat object `obj`.

    Raises
    ------
    ObjectError
        When it is missing or impossible: the object was copied or changed by another program.
    """
    count = obj.get(COUNT_KEY)
    if not isinstance(count, int) or not 0 <= count <= _MAX_SCENE_COUNT:
        raise ObjectError(f"{obj.name} does not say how many Gaussians its scene has. Open the project in a new file.")
    return count


def record_of(obj: bpy.types.Object) -> MuseumRecord:
    """Return the catalogue record of `obj`."""
    properties: HeritageObject = obj.heritage
    return MuseumRecord(properties.catalogue_number, properties.title, properties.rights, properties.notes)


def show_level(obj: bpy.types.Object) -> None:
    """Set the membership of the Gaussians of `obj` to that of its current level, read from the project.

    Raises
    ------
    HeritageError
        When the project no longer has that level, or the object is in Edit Mode.
    """
    properties: HeritageObject = obj.heritage
    splats = SplatScene.of(obj)
    if (properties.level, properties.n_levels) == (0, 1):
        return
    count = scene_count(obj)
    membership = load_level(project_of(properties), properties.object_id, properties.level, count)
    index = splats.index(count)
    splats.set_membership(np.where(index >= 0, membership[index], 0.0).astype(np.float32))


def apply_visibility(scene: bpy.types.Scene) -> None:
    """Show either a whole scene or its objects: showing both would draw their Gaussians twice.

    An object whose own scene is not in `scene`, such as one appended from another file, stays visible. The eye of the
    list is that of Blender's outliner. What was selected stays selected when it is shown again.
    """
    chosen = active_object(scene)
    objects = heritage_objects(scene)
    for obj, replaced in zip(objects, _are_replaced(scene, objects), strict=True):
        obj.hide_viewport, obj.hide_render = replaced, replaced or obj.heritage.hidden
        show_meshes(obj, view_layer_of(scene), replaced=replaced)
        for layer in scene.view_layers:
            if layer.objects.get(obj.name) == obj and obj.hide_get(view_layer=layer) != obj.heritage.hidden:
                obj.hide_set(obj.heritage.hidden, view_layer=layer)
    layer = view_layer_of(scene)
    if chosen is not None and layer.objects.active == chosen and chosen.visible_get(view_layer=layer):
        chosen.select_set(True, view_layer=layer)


def _are_replaced(scene: bpy.types.Scene, objects: list[bpy.types.Object]) -> list[bool]:
    """Return of each splat object whether others are shown in its place."""
    shows_objects = scene.heritage.show == "OBJECTS"
    wholes = {_project_name(obj.heritage) for obj in objects if obj.heritage.role == "SCENE"}
    parted = {_project_name(obj.heritage) for obj in objects if obj.heritage.role == "OBJECT"}
    if scene.heritage.project:
        parted.add(bpy.path.abspath(scene.heritage.project))
    replaced = []
    for obj in objects:
        project = _project_name(obj.heritage)
        is_whole = obj.heritage.role == "SCENE"
        # Splats without a project, of a file of any program, belong to no others.
        has_other = project in parted and shows_objects if is_whole else project in wholes and not shows_objects
        replaced.append(bool(project) and has_other)
    return replaced


def follow_eyes(scene: bpy.types.Scene) -> None:
    """Take over the eyes of Blender's outliner, which H and Alt+H change as well, into the list of `scene`."""
    layer, objects = view_layer_of(scene), heritage_objects(scene)
    changed = [
        obj
        for obj in objects
        if layer.objects.get(obj.name) == obj and obj.hide_get(view_layer=layer) != obj.heritage.hidden
    ]
    if not changed:
        return
    for obj in changed:
        obj.heritage.hidden = obj.hide_get(view_layer=layer)
    apply_visibility(scene)


def _project_name(properties: HeritageScene | HeritageObject) -> str:
    # What linked data names is relative to its own file.
    return bpy.path.abspath(properties.project, library=properties.id_data.library) if properties.project else ""


def view_transform_of(scene: bpy.types.Scene) -> str:
    """Return the view transform that the blending mode of `scene` needs."""
    return "Raw" if scene.heritage.blending == "TRAINED" else "Standard"


def apply_blending(scene: bpy.types.Scene) -> None:
    """Apply the blending mode of `scene` to all its splats. The view transform belongs to the user and stays."""
    as_trained = scene.heritage.blending == "TRAINED"
    for obj in heritage_objects(scene):
        set_display_input(obj, AS_TRAINED, as_trained)


def _threshold_changed(properties: HeritageObject, context: bpy.types.Context) -> None:
    set_display_input(properties.id_data, THRESHOLD, properties.threshold)


def _level_changed(properties: HeritageObject, context: bpy.types.Context) -> None:
    if properties.is_loading:
        return
    show_level(properties.id_data)
    properties.problem = ""


def _hidden_changed(properties: HeritageObject, context: bpy.types.Context) -> None:
    for scene in properties.id_data.users_scene:
        apply_visibility(scene)


def _get_part_to_whole(properties: HeritageObject) -> float:
    return properties.level / max(1, properties.n_levels - 1)


def _set_part_to_whole(properties: HeritageObject, value: float) -> None:
    level = round(value * (properties.n_levels - 1))
    # Dragging the slider calls this at every pixel, but the Gaussians change only with the level.
    if level != properties.level:
        properties.level = level


_record_writer: Callable[[bpy.types.Object], None] | None = None


def set_record_writer(write: Callable[[bpy.types.Object], None] | None) -> None:
    """Set the function that stores the record of an object in its project."""
    global _record_writer
    _record_writer = write


def _record_changed(properties: HeritageObject, context: bpy.types.Context) -> None:
    # The .blend file always keeps the record. The copy in the project is for exports by the engine.
    if properties.project and properties.object_id and not properties.is_loading and _record_writer is not None:
        _record_writer(properties.id_data)
        properties.problem = ""


def photo_alpha(scene: bpy.types.Scene) -> float:
    """Return the opacity with which Blender draws a photo. Splats that are drawn over it fade instead."""
    opacity: float = scene.heritage.photo_opacity
    return opacity if scene.heritage_display.kind == "SHAPES" else float(opacity > 0)


def apply_photo_opacity(scene: bpy.types.Scene) -> None:
    """Apply the opacity of the photos of `scene`."""
    for obj in scene.objects:
        if photo_of(obj):
            for background in obj.data.background_images:
                background.alpha = photo_alpha(scene)


def _photo_opacity_changed(properties: HeritageScene, context: bpy.types.Context) -> None:
    apply_photo_opacity(properties.id_data)


def _show_changed(properties: HeritageScene, context: bpy.types.Context) -> None:
    apply_visibility(properties.id_data)


def _get_active(properties: HeritageScene) -> int:
    obj = active_object(properties.id_data)
    return -1 if obj is None else int(bpy.data.objects.find(obj.name))


def _get_deleted(properties: HeritageScene) -> str:
    """Return the objects that this scene has had of its project and that no scene of the file has any more."""
    known = [one for one in properties.known.split("\n") if one]
    if not known:
        return ""
    project = _project_name(properties)
    present = {
        obj.heritage.object_id
        for scene in bpy.data.scenes
        for obj in heritage_objects(scene, "OBJECT")
        if _project_name(obj.heritage) == project
    }
    return "\n".join(one for one in known if one not in present)


def _set_active(properties: HeritageScene, number: int) -> None:
    obj = bpy.data.objects[number] if 0 <= number < len(bpy.data.objects) else None
    set_active_object(properties.id_data, obj)


def _get_known_distance(properties: HeritageScene) -> str:
    return write_length(properties.known_distance)


def _set_known_distance(properties: HeritageScene, text: str) -> None:
    properties.known_distance = read_length(text)


def _blending_changed(properties: HeritageScene, context: bpy.types.Context) -> None:
    scene = properties.id_data
    apply_blending(scene)
    # It follows where it was set up for splats and nobody has chosen another one since then.
    if properties.former_settings and scene.view_settings.view_transform in ("Raw", "Standard"):
        scene.view_settings.view_transform = view_transform_of(scene)


@blender_properties
class HeritageScene(bpy.types.PropertyGroup):
    """Properties of a scene: ``scene.heritage``."""

    project: str = StringProperty(
        name="Project",
        description="Project folder of this scene",
        subtype="DIR_PATH",
        options={"PATH_SUPPORTS_BLEND_RELATIVE"},
    )
    camera_colour: str = StringProperty(
        name="Colour of the Cameras' Health", description="green, yellow or red; empty if unknown"
    )
    camera_health: str = StringProperty(
        name="Health of the Cameras", description="What the photos say about their cameras"
    )
    prompt: str = StringProperty(
        name="Prompt",
        description="Objects to isolate, in English words; separate several with commas (vase, teapot)",
    )
    question: str = StringProperty(
        name="Question",
        description="Things to look for in the scene so far, in English words; separate several with commas",
    )
    known_distance: float = FloatProperty(
        name="Metres",
        description="A distance that you have measured on the real object, in metres; then pick its two ends",
        min=0.0001,
        default=1.0,
        precision=4,
    )
    # Blender's own fields take units only in scenes that have some, and the unit of a scene is unknown at first.
    known_distance_text: str = StringProperty(
        name="Distance",
        description="A distance that you have measured on the real object, such as 30 cm; then pick its two ends",
        get=_get_known_distance,
        set=_set_known_distance,
    )
    photo_opacity: float = FloatProperty(
        name="Photo",
        description="Opacity of the photo over the splats",
        min=0.0,
        max=1.0,
        default=1.0,
        subtype="FACTOR",
        update=_photo_opacity_changed,
    )
    # The list needs an index of bpy.data.objects. It shifts when any object is made, renamed or deleted, so the name
    # and the id are stored instead.
    active: int = IntProperty(name="Active Object", get=_get_active, set=_set_active)
    active_name: str = StringProperty(name="Name of the Active Object")
    active_id: str = StringProperty(name="Id of the Active Object")
    # Ids of the objects of the project that this scene has had, one a line.
    known: str = StringProperty(options={"HIDDEN"})
    # However an object was deleted: in the list, by a key, in the outliner.
    deleted: str = StringProperty(
        name="Deleted Objects",
        description="Ids of objects that were deleted in this file, one a line, until stored",
        get=_get_deleted,
    )
    show: str = EnumProperty(
        name="Show",
        items=[
            ("SCENE", "Scene", "Show the whole scene"),
            ("OBJECTS", "Objects", "Show the isolated objects"),
        ],
        update=_show_changed,
    )
    # JSON of the settings that the user had before the scene was set up for splats.
    former_settings: str = StringProperty(options={"HIDDEN"})
    blending: str = EnumProperty(
        name="Blending",
        items=[
            ("LINEAR", "Linear", "Blend light, like other objects in Blender; uses the view transform Standard"),
            ("TRAINED", "As Trained", "Match the colours of the photos; uses the view transform Raw"),
        ],
        update=_blending_changed,
    )


@blender_properties
class HeritageObject(bpy.types.PropertyGroup):
    """Properties of a splat object: ``obj.heritage``."""

    role: str = EnumProperty(
        name="Role",
        items=[
            ("NONE", "None", ""),
            ("SCENE", "Scene", "A whole scene"),
            ("OBJECT", "Object", "An isolated object"),
        ],
    )
    project: str = StringProperty(name="Project", subtype="DIR_PATH", options={"PATH_SUPPORTS_BLEND_RELATIVE"})
    object_id: str = StringProperty(name="Object Id")
    prompt: str = StringProperty(name="Prompt")
    score: float = FloatProperty(name="Confidence", description="Confidence that this is the requested object, 0 to 1")
    threshold: float = FloatProperty(
        name="Threshold",
        description="Smallest membership of a Gaussian in the object; higher values make the object tighter",
        default=DEFAULT_THRESHOLD,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        update=_threshold_changed,
    )
    kind: str = StringProperty(name="Kind", description="How the object was found: text, click, all or background")
    hidden: bool = BoolProperty(
        name="Hidden", description="Hide this object in viewports and renders", update=_hidden_changed
    )
    level: int = IntProperty(name="Level", description="0 is the smallest part", min=0, update=_level_changed)
    n_levels: int = IntProperty(name="Levels", min=1, default=1)
    stored_level: int = IntProperty(name="Level in the Project", min=0)
    part_to_whole: float = FloatProperty(
        name="Part to Whole",
        description="From the smallest part (a lid) to the whole it belongs to (the vase)",
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        get=_get_part_to_whole,
        set=_set_part_to_whole,
    )
    catalogue_number: str = StringProperty(name="Catalogue Number", update=_record_changed)
    title: str = StringProperty(name="Title", update=_record_changed)
    rights: str = StringProperty(
        name="Rights", description="Credit line, licence or rights statement", update=_record_changed
    )
    notes: str = StringProperty(name="Notes", update=_record_changed)
    is_edited: bool = BoolProperty(
        name="Edited by Hand", description="Changed in this file, and not yet stored in the project"
    )
    problem: str = StringProperty(options={"SKIP_SAVE"})
    is_loading: bool = BoolProperty(options={"SKIP_SAVE", "HIDDEN"})


@blender_properties
class HeritageClick(bpy.types.PropertyGroup):
    """A clicked pixel of a photo, as an argument of operators."""

    photo: str = StringProperty(name="Photo")
    x: float = FloatProperty(name="X", description="Pixels from the left edge of the photo")
    y: float = FloatProperty(name="Y", description="Pixels from the top edge of the photo")
    wanted: bool = BoolProperty(name="Wanted", description="Off: this pixel is not part of the object", default=True)


CLASSES = [HeritageScene, HeritageObject, HeritageClick]


def register() -> None:
    """Add the property groups to scenes and objects. Their classes must be registered already."""
    add_property(bpy.types.Scene, "heritage", HeritageScene)
    add_property(bpy.types.Object, "heritage", HeritageObject)
