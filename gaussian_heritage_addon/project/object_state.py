"""The state of the project's object that a Blender object shows: ``obj.heritage_state``, and which object shows it.

One object of a file shows an object of the project, its owner. Copies, and what was appended or linked from another
file, are no owners: what is changed in them stays in this file.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import bpy
from bpy.props import BoolProperty, FloatProperty, StringProperty

from ..blender.guards import add_property
from ..blender.typed_properties import blender_properties
from ..splats.properties import HeritageObject, HeritageScene
from ..splats.selection import heritage_objects


@blender_properties
class HeritageState(bpy.types.PropertyGroup):
    """Properties of an isolated object that Blender undoes with it: ``obj.heritage_state``."""

    state: str = StringProperty(options={"HIDDEN"})
    """State of the object in the project, as of `state_of`, that is shown here; empty for one that is new."""
    threshold: float = FloatProperty(default=-1.0, options={"HIDDEN"})
    """Threshold that the project had for it."""
    object_name: str = StringProperty(options={"HIDDEN"})
    """Name that it has, or gets, in its project."""
    shown_name: str = StringProperty(options={"HIDDEN"})
    """Name that Blender had for that name: another one where the name was in use."""
    stored_name: str = StringProperty(options={"HIDDEN"})
    """Name that the project was seen to have last."""
    is_copy: bool = BoolProperty(options={"HIDDEN"})
    """Whether it was copied or appended: what is changed in it stays in this file."""


CLASSES = [HeritageState]


def all_objects() -> Iterator[bpy.types.Object]:
    """Yield the isolated objects of all scenes of this file, each once, without those of linked files."""
    seen = set()
    for scene in bpy.data.scenes:
        for obj in heritage_objects(scene, "OBJECT"):
            if obj.library is None and obj.override_library is None and obj.name not in seen:
                seen.add(obj.name)
                yield obj


def _places() -> dict[tuple[Path, str], list[bpy.types.Object]]:
    """Return the objects of projects by project and id."""
    places: dict[tuple[Path, str], list[bpy.types.Object]] = {}
    for obj in all_objects():
        if obj.heritage.project and obj.heritage.object_id:
            places.setdefault((_folder(obj.heritage), obj.heritage.object_id), []).append(obj)
    return places


def _folder(properties: HeritageScene | HeritageObject) -> Path:
    """Return the same as `project_of` without looking at the disk: this is asked at every change of an object."""
    library = properties.id_data.library
    return Path(os.path.abspath(bpy.path.abspath(properties.project, library=library)))


def known_objects(project: Path) -> set[str]:
    """Return the ids of the objects of a project that any scene of this file has had."""
    return {one for scene in _scenes_of(project) for one in scene.known.split("\n") if one}


def _scenes_of(project: Path) -> list[HeritageScene]:
    scenes = [scene.heritage for scene in bpy.data.scenes if scene.library is None and scene.heritage.project]
    return [one for one in scenes if _folder(one) == project]


def add_known(project: Path, obj: bpy.types.Object) -> None:
    """Note that the scenes of `project` that `obj` is in have had the object that it shows."""
    for scene in obj.users_scene:
        if scene.library is None and scene.heritage.project and _folder(scene.heritage) == project:
            known = [one for one in scene.heritage.known.split("\n") if one]
            if obj.heritage.object_id not in known:
                scene.heritage.known = "\n".join((*known, obj.heritage.object_id))


def forget_known(project: Path, ids: Iterable[str]) -> None:
    """Note that these objects of a project are gone there, too."""
    gone = set(ids)
    for scene in _scenes_of(project):
        scene.known = "\n".join(one for one in scene.known.split("\n") if one and one not in gone)


def owners() -> dict[tuple[Path, str], bpy.types.Object]:
    """Return the object that shows each object of a project in this file, by project and id."""
    return {
        place: originals[0]
        for place, objects in _places().items()
        if (originals := [obj for obj in objects if not obj.heritage_state.is_copy])
    }


def mark_copies() -> None:
    """Mark all but the first of several objects that show the same one. A copy becomes the owner where none is left."""
    for (project, object_id), objects in _places().items():
        originals = [obj for obj in objects if not obj.heritage_state.is_copy]
        if len(originals) > 1:
            first = min(originals, key=lambda obj: int(obj.session_uid))
            for obj in originals:
                obj.heritage_state.is_copy = obj != first
        elif not originals:
            heirs = [obj for obj in objects if _is_known(obj, project, object_id)]
            if heirs:
                min(heirs, key=lambda obj: int(obj.session_uid)).heritage_state.is_copy = False


def _is_known(obj: bpy.types.Object, project: Path, object_id: str) -> bool:
    """Return whether a scene with `obj` has had that object of the project."""
    scenes = [scene.heritage for scene in obj.users_scene if scene.heritage.project]
    return any(_folder(one) == project and object_id in one.known.split("\n") for one in scenes)


def register() -> None:
    """Add the properties to objects. Their class must be registered already."""
    add_property(bpy.types.Object, "heritage_state", HeritageState)
