"""Finds the project of a .blend file again after both were moved together, and tells where it is missing."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import bpy

from ...engine.core.errors import HeritageError, ProjectError
from ...engine.core.files import path_within
from ...engine.project.content import is_project, shown_objects
from ...engine.scene import read_camera_set
from ..blender import problems
from ..splats.properties import HeritageObject, HeritageScene, photo_of, project_of

_PLACE_KEY = "heritage_project_place"
"""Custom property of a scene: the folder of its project when the .blend was saved, which may be moved alone."""
_before: list[tuple[bpy.types.ID, Path]] = []


def is_missing(properties: HeritageScene | HeritageObject) -> bool:
    """Return whether a scene or object names a project that is not there."""
    if not properties.project:
        return False
    try:
        return not is_project(project_of(properties))
    except ProjectError:  # no folder can have that path
        return True


def _sentence(project: Path) -> str:
    return f"The project {project} is missing. Choose the folder that it is in now with Find Project."


def _holders() -> Iterator[bpy.types.Scene | bpy.types.Object]:
    """Yield the scenes and objects of this file that name a project; those of linked files cannot be changed.

    A path that no folder can have, in a file of someone else, is left as it is.
    """
    for one in (*bpy.data.scenes, *bpy.data.objects):
        if one.library is not None or not one.heritage.project:
            continue
        try:
            project_of(one.heritage)
        except ProjectError:
            continue
        yield one


def _stored(project: Path, folder: Path | None) -> str:
    """Return the path to store in a .blend in `folder`: relative where the project lies beside or within it."""
    try:
        relative = "" if folder is None else os.path.relpath(project, folder)
    except ValueError:  # another drive of Windows
        relative = ""
    parts = Path(relative).parts
    return str(project) if not relative or parts[:2] == ("..", "..") else f"//{relative}".replace(os.sep, "/")


def before_saving(file: str) -> None:
    """Store the paths of projects as `file`, the .blend to be written, needs them."""
    _before[:] = [(one, project_of(one.heritage)) for one in _holders()]
    for one, project in _before:
        one.heritage.project = _stored(project, Path(file).absolute().parent if file else None)
        if isinstance(one, bpy.types.Scene) and is_project(project):
            one[_PLACE_KEY] = str(project)


def after_saving(file: str) -> None:
    """Store the paths as the present file needs them: it is another one after a copy was saved."""
    folder = Path(bpy.data.filepath).parent if bpy.data.filepath else None
    for one, project in _before:
        one.heritage.project = _stored(project, folder)
    _before.clear()


def after_appending(items: list[tuple[bpy.types.ID, str]]) -> None:
    """Make the paths of appended scenes and objects absolute: they are relative to the .blend that they came from.

    Appended objects are copies: what is changed in them stays in this file.
    """
    for one, file in items:
        is_holder = isinstance(one, bpy.types.Scene | bpy.types.Object) and one.library is None
        if is_holder and one.heritage.project.startswith("//"):
            folder = Path(bpy.path.abspath(file)).absolute().parent
            one.heritage.project = os.path.abspath(folder / one.heritage.project.removeprefix("//"))
        if isinstance(one, bpy.types.Object) and one.library is None:
            one.heritage_state.is_copy = True


def find_moved() -> None:
    """Look for projects that are missing beside the .blend and where they were, and say which are not there either."""
    missing = {project_of(one.heritage) for one in _holders() if is_missing(one.heritage)}
    if not bpy.data.filepath:
        return
    folder = Path(bpy.data.filepath).parent
    lost = []
    for project in sorted(missing):
        beside = [folder / project.name, folder.parent / project.name, folder, *_former_places(project)]
        found = next((one for one in beside if is_project(one) and _fits(project, one)), None)
        if found is None:
            lost.append(project)
        else:
            relink(project, found)
    if lost:
        problems.show(" ".join(_sentence(project) for project in lost))


def _former_places(project: Path) -> list[Path]:
    """Return where `project`, which a scene names, was when the .blend was saved; only absolute paths are taken."""
    places = [
        one.get(_PLACE_KEY)
        for one in _holders()
        if isinstance(one, bpy.types.Scene) and project_of(one.heritage) == project
    ]
    return [Path(place) for place in places if isinstance(place, str) and Path(place).is_absolute()]


def relink(old: Path, new: Path) -> None:
    """Change the project of the scenes and objects that name `old` to `new`."""
    folder = Path(bpy.data.filepath).parent if bpy.data.filepath else None
    for one in _holders():
        if project_of(one.heritage) == old:
            one.heritage.project = _stored(new, folder)


def relink_scene_of(project: Path) -> None:
    """Relink to `project` what belongs to it and names a folder that is not there."""
    for old in {project_of(one.heritage) for one in _holders() if is_missing(one.heritage)}:
        if _fits(old, project):
            relink(old, project)


def _fits(old: Path, new: Path) -> bool:
    """Return whether `new` can be the project `old`: it has photos of the same names, and an object of the same id."""
    scenes = [one for one in bpy.data.scenes if one.heritage.project and project_of(one.heritage) == old]
    objects = [one for one in _holders() if isinstance(one, bpy.types.Object) and project_of(one.heritage) == old]
    photos = {photo_of(one) for scene in scenes for one in scene.objects} - {""}
    ids = {one.heritage.object_id for one in objects if one.heritage.role == "OBJECT"} - {""}
    try:
        cameras = path_within(new, "cameras")
        known = {one.photo for one in read_camera_set(cameras).cameras} if photos else set()
        known_ids = {item.id for item in shown_objects(new)}
    except HeritageError:
        return False
    return photos <= known and (not ids or bool(ids & known_ids) or bool(photos))
