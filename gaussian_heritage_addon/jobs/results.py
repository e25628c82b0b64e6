"""The results of finished jobs in Blender: which scene they enter, and how they are imported."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy

from ...engine.core.errors import EnvironmentProblem, ProjectError
from ...engine.core.files import delete_derived
from ...engine.project.refused_prompts import dismiss
from ...engine.workers.jobs import Job, JobState
from ..project.hand_edits import was_edited_meanwhile
from ..project.new_objects import show_new_objects
from ..project.object_mesh import add_mesh
from ..project.object_state import forget_known, owners
from ..project.project_history import look_again, remember_objects
from ..project.scene_file import add_objects, open_project, scene_name
from ..setup.model_files import states_of
from ..setup.preferences import store_check_result, store_model_states
from ..splats.properties import project_of
from ..splats.selection import heritage_objects, set_active_object
from ..splats.solid_mode import update_shapes

PROJECT_KINDS = ("reconstruct", "segment", "mesh")
"""Kinds of jobs whose results enter a scene."""


def destination(project: Path, *, only_if_shown: bool = False) -> bpy.types.Scene | None:
    """Return the scene that results of `project` enter; None where the user has to be asked.

    It is the scene that shows the project, otherwise the current scene unless that shows another project, or
    `only_if_shown`.
    """
    current = bpy.context.scene
    for scene in (current, *bpy.data.scenes):
        if scene.heritage.project and project_of(scene.heritage) == project:
            return scene
    return None if current.heritage.project or only_if_shown else current


def scene_for(project: Path) -> bpy.types.Scene:
    """Return `destination`, or else a new scene of this file with the name of the project."""
    return destination(project) or bpy.data.scenes.new(scene_name(project))


def is_editing() -> bool:
    """Return whether splats are in Edit Mode, in which their mesh cannot be replaced."""
    return any(obj.mode == "EDIT" for scene in bpy.data.scenes for obj in heritage_objects(scene))


def import_results(job: Job, state: JobState, scene: bpy.types.Scene) -> None:
    """Import the results of a finished job into `scene`.

    Raises
    ------
    HeritageError
        When a file of the project cannot be read, or a check found that something is missing.
    """
    importer = _IMPORTERS.get(job.kind)
    if importer is not None:
        importer(Path(job.subject), state, scene)
        update_shapes()
        if any(word.startswith("--accept") for word in job.command):
            dismiss(Path(job.subject))


def _import_scene(project: Path, state: JobState, scene: bpy.types.Scene) -> None:
    open_project(scene, project)
    look_again()
    scene.heritage.show = "SCENE"


def _import_objects(project: Path, state: JobState, scene: bpy.types.Scene) -> None:
    found, existing = _ids(state, "objects"), _ids(state, "existing")
    gone = scene.heritage.deleted.split("\n")
    new_ids, kept_ids = [one for one in found if one not in existing], [*_ids(state, "kept"), *existing]
    # What was deleted in this file, and is not stored yet, comes back only where it was asked for.
    kept_ids = [one for one in kept_ids if one in existing or one not in gone]
    scene.heritage.project = str(project)
    present = {obj.heritage.object_id: obj for obj in heritage_objects(scene, "OBJECT")}
    shown_before = {one for one in new_ids if one in present}
    # They stay as they are, marked as not stored.
    edited = [one for one in new_ids if one in present and was_edited_meanwhile(present[one], project)]
    new_ids = [one for one in new_ids if one not in edited]
    before = {object_id: _state_of(obj) for (one, object_id), obj in owners().items() if one == project}
    deleted = _ids(state, "deleted")
    # Objects of the project that were found again may be missing in this file.
    add_objects(scene, project, [*new_ids, *(object_id for object_id in kept_ids if object_id not in present)])
    forget_known(project, deleted)
    before |= dict(zip(deleted, _ids(state, "deleted_states"), strict=False))
    remember_objects(project, before, [*new_ids, *deleted])
    scene.heritage.show = "OBJECTS"
    show_new_objects(scene, found, known=shown_before)


def _import_mesh(project: Path, state: JobState, scene: bpy.types.Scene) -> None:
    object_id, file = state.outputs.get("object"), state.outputs.get("file")
    if not isinstance(object_id, str) or not isinstance(file, str):
        raise ProjectError("The engine did not say of which object it made a mesh. Make the mesh again.")
    obj = next((one for one in heritage_objects(scene, "OBJECT") if one.heritage.object_id == object_id), None)
    if obj is None:
        raise ProjectError(f"The object {object_id} is no longer in this scene; its mesh is in {file}.")
    add_mesh(obj, Path(file))
    # Blender has it now, so that what is deleted there leaves nothing behind.
    delete_derived(project, "meshes", Path(file).name)
    # Blender's importer selects what it made, which is no object of the list.
    set_active_object(scene, obj)


def _state_of(obj: bpy.types.Object) -> str | None:
    """Return the state of its project's object that `obj` shows; None where it was made by hand and not stored yet."""
    state: str = obj.heritage_state.state
    return None if not state and obj.heritage.is_edited else state


def _ids(state: JobState, name: str) -> list[str]:
    """Return the ids of objects in the outputs of a job."""
    ids = state.outputs.get(name, [])
    if not isinstance(ids, list) or not all(isinstance(object_id, str) for object_id in ids):
        raise ProjectError(f"The engine did not say which objects it made ({name}). Open the project again.")
    return ids


def _store_model_states(subject: Path, state: JobState, scene: bpy.types.Scene) -> None:
    store_model_states(states_of(state.outputs))


def _store_checks(subject: Path, state: JobState, scene: bpy.types.Scene) -> None:
    store_check_result(state.message)
    checks = state.outputs.get("checks")
    if not isinstance(checks, list) or not all(isinstance(check, dict) for check in checks):
        raise EnvironmentProblem("The engine did not say what it has and lacks. Set it up again.")
    missing = [str(check.get("name")) for check in checks if check.get("required") and not check.get("ok")]
    if missing:
        raise EnvironmentProblem(f"The engine lacks {', '.join(missing)}. Set it up again, then check it again.")


_IMPORTERS: dict[str, Callable[[Path, JobState, bpy.types.Scene], None]] = {
    "reconstruct": _import_scene,
    "segment": _import_objects,
    "mesh": _import_mesh,
    "models": _store_model_states,
    "doctor": _store_checks,
}
