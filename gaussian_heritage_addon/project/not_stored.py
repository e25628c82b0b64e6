"""Differences of a scene in Blender from its project, which *Store* writes there by one press."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import bpy
import numpy as np

from ...engine.core.errors import ObjectError
from ...engine.core.files import atomic_write
from ...engine.project.folder import ProjectFolder
from ...engine.project.objects import bring_back, new_id, save_record
from ..blender.drawn_text import draw_text
from ..language.translations import translated
from ..setup.preferences import user_folder
from ..splats.properties import HeritageObject, loading, project_of, record_of, scene_count
from ..splats.selection import heritage_objects
from ..splats.splats import SplatScene
from .object_names import ID_KEY, own_collection
from .object_state import all_objects, forget_known, known_objects
from .project_history import look_again
from .stored_objects import StoredObject, look, seen


def changes_of(obj: bpy.types.Object, stored: StoredObject | None) -> list[str]:
    """Return in which ways an isolated object is not as `stored` in its project; a copy is in none.

    Parameters
    ----------
    stored : StoredObject or None
        None where the project does not have it.

    Returns
    -------
    list of str
        ``"new"`` alone; or some of ``"gaussians"``, ``"version"`` (the project has another one), ``"threshold"``,
        ``"level"``, ``"name"`` and ``"record"``.
    """
    properties, state = obj.heritage, obj.heritage_state
    if state.is_copy or not properties.project:
        return []
    if not properties.object_id or stored is None:
        return ["new"]
    is_shown = {
        "gaussians": not properties.is_edited,
        "version": properties.is_edited or state.state == stored.state,
        "threshold": abs(properties.threshold - stored.threshold) < 1e-6,
        "level": properties.level == properties.stored_level,
        "name": state.object_name in ("", stored.name),
        "record": record_of(obj) == stored.record,
    }
    return [what for what, is_same in is_shown.items() if not is_same]


def unstored_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the isolated objects of `scene` that its project does not have as they are shown, as last looked."""
    return [obj for obj in heritage_objects(scene, "OBJECT") if is_unstored(obj)]


def is_unstored(obj: bpy.types.Object) -> bool:
    """Return whether the project of an isolated object does not have it as it is shown, as last looked."""
    if obj.library is not None or obj.heritage_state.is_copy:
        return False
    stored = seen(obj.heritage)
    # Of a project that is missing, nothing is known.
    return bool(obj.heritage.is_edited or (stored is not None and changes_of(obj, stored.get(obj.heritage.object_id))))


def has_other_shape(obj: bpy.types.Object) -> bool:
    """Return whether the project of an isolated object has other Gaussians of it than are shown, as last looked."""
    stored = seen(obj.heritage)
    changes = [] if stored is None else changes_of(obj, stored.get(obj.heritage.object_id))
    return bool(obj.heritage.is_edited or {"new", "version", "threshold", "level"} & set(changes))


def deleted_names(scene: bpy.types.Scene) -> list[str]:
    """Return the names of the objects that were deleted in this file, but not in the project."""
    stored = seen(scene.heritage) or {}
    return [stored[one].name for one in scene.heritage.deleted.split("\n") if one in stored]


def missing_names(scene: bpy.types.Scene) -> list[str]:
    """Return the names of the objects of the project that no scene of this file has had."""
    stored, project = seen(scene.heritage), scene.heritage.project
    if not stored or not project:
        return []
    known = known_objects(project_of(scene.heritage))
    shown = {obj.heritage.object_id for obj in heritage_objects(scene, "OBJECT")}
    return [one.name for object_id, one in stored.items() if object_id not in known and object_id not in shown]


def draw_not_stored(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """Draw what is not stored, and the button that stores it; nothing where Blender and the project agree."""
    names, deleted, missing = [obj.name for obj in unstored_objects(scene)], deleted_names(scene), missing_names(scene)
    if names:
        draw_text(layout, translated("Not stored: {}", ", ".join(names)), icon="INFO")
    if deleted:
        draw_text(layout, translated("Deleted, not stored: {}", ", ".join(deleted)), icon="INFO")
    if names or deleted:
        layout.operator("heritage.store_edits", icon="FILE_TICK")
    if missing:
        draw_text(layout, translated("Only in the project: {}", ", ".join(missing)), icon="INFO")
        layout.operator("heritage.open_project", icon="FILE_REFRESH").directory = str(project_of(scene.heritage))


def store_arguments(scene: bpy.types.Scene) -> list[str]:
    """Store records, write what was edited to files, and return the arguments of ``edit`` that store the rest.

    New objects get their ids. States that the trash of the project has are brought back from there.

    Returns
    -------
    list of str
        Empty where everything is stored already.

    Raises
    ------
    ObjectError
        When the project has all that Blender shows.
    HeritageError
        When a file cannot be written, or a job works in the project.
    """
    project = project_of(scene.heritage)
    look_again()
    stored = look(project)
    unstored = [
        (obj, changes)
        for obj in all_objects()
        if obj.heritage.project and project_of(obj.heritage) == project
        if (changes := changes_of(obj, stored.get(obj.heritage.object_id)))
    ]
    deleted = [one for one in scene.heritage.deleted.split("\n") if one]
    forget_known(project, [one for one in deleted if one not in stored])
    gone = [one for one in deleted if one in stored]
    if not unstored and not gone:
        raise ObjectError("The project has everything that Blender shows.")
    arguments = [f"--delete={object_id}" for object_id in gone]
    folder = user_folder("edits") / f"{datetime.now(UTC):%Y%m%d-%H%M%S-%f}"
    taken = [*stored, *known_objects(project), *(obj.heritage.object_id for obj, _ in unstored)]
    for obj, changes in unstored:
        arguments += _arguments_of(obj, changes, project, taken, folder)
    look_again()
    return arguments


def _arguments_of(
    obj: bpy.types.Object, changes: Sequence[str], project: Path, taken: list[str], folder: Path
) -> list[str]:
    """Return the arguments that store one object."""
    properties, state = obj.heritage, obj.heritage_state
    name = state.object_name or obj.name
    if not properties.object_id:
        collection = own_collection(obj)
        with loading(properties):
            properties.object_id = new_id(name, taken)
        taken.append(properties.object_id)
        if collection is not None:
            collection[ID_KEY] = properties.object_id
    object_id, arguments = properties.object_id, []
    is_back = ("new" in changes or "version" in changes) and not properties.is_edited and _is_back(project, obj)
    if not is_back and {"new", "gaussians", "version"} & set(changes):
        file = folder / f"{object_id}.npy"
        _write_membership(file, obj)
        arguments += [f"--set={object_id}={file}", f"--threshold={object_id}={properties.threshold:.6g}"]
    else:
        if "threshold" in changes:
            arguments.append(f"--threshold={object_id}={properties.threshold:.6g}")
        if "level" in changes:
            arguments.append(f"--level={object_id}={properties.level}")
    if "new" in changes or "name" in changes:
        arguments.append(f"--rename={object_id}={name}")
    if "record" in changes or ("new" in changes and record_of(obj).as_dict()):
        save_record(project, object_id, record_of(obj))
    return arguments


def _is_back(project: Path, obj: bpy.types.Object) -> bool:
    """Bring back the state that an object shows from the trash of its project; return whether that has it."""
    properties: HeritageObject = obj.heritage
    if not obj.heritage_state.state:
        return False
    with ProjectFolder.open_existing(project) as opened:
        try:
            bring_back(opened, properties.object_id, obj.heritage_state.state, why="replaced by what Blender shows")
        except ObjectError:
            return False
    return True


def _write_membership(file: Path, obj: bpy.types.Object) -> None:
    splats, count = SplatScene.of(obj), scene_count(obj)
    rows, membership = splats.index(count), splats.membership
    stored = np.zeros(count, np.float32)
    values = np.ones(len(rows), np.float32) if membership is None else membership
    known = rows >= 0
    np.maximum.at(stored, rows[known], values[known])
    with atomic_write(file) as stream:
        np.save(stream, np.clip(stored, 0.0, 1.0), allow_pickle=False)
