"""Runs one engine job at a time: operators start it, a timer polls it, and its results are imported at the end."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Sequence
from pathlib import Path

import bpy

from ..engine.errors import Cancelled, EnvironmentProblem, HeritageError, ProjectError
from . import problems
from .engine_process import engine_command
from .guards import Timer, redraw
from .jobs import Job, JobState
from .model_files import states_of
from .preferences import (
    current_environment,
    current_python,
    store_check_result,
    store_model_states,
    user_folder,
)
from .properties import heritage_objects, project_of, select_object
from .scene_file import add_objects, open_project

__all__ = ["ENGINE", "MODEL_FILES", "cancel", "current", "problem", "register", "start", "start_command", "unregister"]

_LOG = logging.getLogger(__name__)
_POLL_INTERVAL = 0.5
"""Seconds between two polls of the job."""
MODEL_FILES = Path("model files")
"""Subject of jobs about model files, which belong to no project."""
ENGINE = Path("the engine")
"""Subject of jobs about the engine itself."""
_EDIT_MODE_MESSAGE = "Leave Edit Mode (Tab) to import the finished result."
_job: Job | None = None
_waits_for_object_mode = False


def current() -> tuple[Job, JobState] | None:
    """Return the last job and its state, or None."""
    return None if _job is None else (_job, _job.poll())


def problem() -> str:
    """Return why the results of the last job are not imported yet; empty when nothing is in the way."""
    return _EDIT_MODE_MESSAGE if _waits_for_object_mode else ""


def start(kind: str, subject: Path, *arguments: str) -> JobState | None:
    """Run the engine with `arguments`; see `start_command`.

    Raises
    ------
    HeritageError
        When there is no interpreter, and as `start_command`.
    """
    return start_command(kind, subject, engine_command(current_python(), *arguments))


def start_command(kind: str, subject: Path, command: Sequence[str]) -> JobState | None:
    """Run a program that writes events. In background mode, wait for it and import its results.

    Parameters
    ----------
    kind : str
        ``"reconstruct"``, ``"segment"``, ``"models"``, ``"doctor"``, ``"set-up"`` or ``"remove engine"``. It determines
        what is done with the results.
    subject : Path
        Project folder, `MODEL_FILES` or `ENGINE`.
    command : sequence of str

    Returns
    -------
    JobState or None
        Final state in background mode. None otherwise: the job runs while Blender is used.

    Raises
    ------
    HeritageError
        When another job is running, or (in background mode) the job failed.
    """
    global _job
    running = current()
    if running is not None and running[1].running:
        raise ProjectError(f"A job is still working on {running[0].subject}. Wait for it or cancel it first.")
    if problem():
        raise ProjectError(problem())
    key = hashlib.sha256(f"{kind} {subject}".encode()).hexdigest()[:16]
    _job = Job.start(
        command,
        user_folder("jobs") / key,
        kind=kind,
        subject=str(subject),
        environment=current_environment(),
    )
    if bpy.app.background:
        state = _job.wait()
        if state.error:
            raise HeritageError(state.error)
        _import_results(_job, state)
        return state
    _poll_timer.start(_POLL_INTERVAL, persistent=True)
    return None


def cancel() -> None:
    """Stop the current job.

    Raises
    ------
    Cancelled
        When no job is running.
    """
    running = current()
    if running is None or not running[1].running:
        raise Cancelled("No job is running.")
    running[0].cancel()


def _poll_job() -> float | None:
    global _waits_for_object_mode
    if _job is None:
        return None
    state = _job.poll()
    redraw()
    if state.running:
        return _POLL_INTERVAL
    _waits_for_object_mode = state.finished and _job.kind in ("reconstruct", "segment") and _is_editing()
    if _waits_for_object_mode:
        return _POLL_INTERVAL
    if state.finished:
        problems.clear()
        _import_results(_job, state)
        # An import by the timer is one undo step. Blender adds none if nothing changed.
        if _job.kind in ("reconstruct", "segment"):
            bpy.ops.ed.undo_push(message=f"Heritage {_job.kind}")
    return None


def _is_editing() -> bool:
    """Return whether splats are in Edit Mode, in which their mesh cannot be replaced."""
    return any(obj.mode == "EDIT" for scene in bpy.data.scenes for obj in heritage_objects(scene))


def _import_results(job: Job, state: JobState) -> None:
    importer = _IMPORTERS.get(job.kind)
    if importer is not None:
        importer(Path(job.subject), state)


def _import_scene(project: Path, state: JobState) -> None:
    open_project(bpy.context.scene, project)


def _import_objects(project: Path, state: JobState) -> None:
    scenes = (scene for scene in bpy.data.scenes if scene.heritage.project and project_of(scene.heritage) == project)
    scene = next(scenes, bpy.context.scene)
    new_ids, kept_ids = _ids(state, "objects"), _ids(state, "kept")
    present = {obj.heritage.object_id for obj in heritage_objects(scene, "OBJECT")}
    # Objects that "find all" kept in the project may be missing in this file.
    add_objects(scene, project, [*new_ids, *(object_id for object_id in kept_ids if object_id not in present)])
    scene.heritage.show = "OBJECTS"
    if new_ids:
        select_object(scene, new_ids[0])


def _ids(state: JobState, name: str) -> list[str]:
    """Return the ids of objects in the outputs of a job."""
    ids = state.outputs.get(name, [])
    if not isinstance(ids, list) or not all(isinstance(object_id, str) for object_id in ids):
        raise ProjectError(f"The engine did not say which objects it made ({name}). Open the project again.")
    return ids


def _store_model_states(subject: Path, state: JobState) -> None:
    store_model_states(states_of(state.outputs))


def _store_checks(subject: Path, state: JobState) -> None:
    """Show the result of a check in the preferences.

    Raises
    ------
    EnvironmentProblem
        When something is missing.
    """
    store_check_result(state.message)
    checks = state.outputs.get("checks")
    if not isinstance(checks, list) or not all(isinstance(check, dict) for check in checks):
        raise EnvironmentProblem("The engine did not say what it has and lacks. Set it up again.")
    missing = [str(check.get("name")) for check in checks if check.get("required") and not check.get("ok")]
    if missing:
        raise EnvironmentProblem(f"The engine lacks {', '.join(missing)}. Set it up again, then check it again.")


_IMPORTERS: dict[str, Callable[[Path, JobState], None]] = {
    "reconstruct": _import_scene,
    "segment": _import_objects,
    "models": _store_model_states,
    "doctor": _store_checks,
}


def _find_running_job() -> None:
    """Continue to poll a job that kept running while Blender was closed. Only folders that we made are searched."""
    global _job
    if _job is None:
        for folder in sorted(user_folder("jobs").iterdir()):
            job = Job.attach(folder)
            if job is not None and job.poll().running:
                _LOG.info("found a running job on %s", job.subject)
                _job = job
                _poll_timer.start(_POLL_INTERVAL, persistent=True)
                return


_poll_timer = Timer(_poll_job)
_search_timer = Timer(_find_running_job)


def register() -> None:
    """Search for a running job of an earlier session, once Blender has started."""
    if not bpy.app.background:
        _search_timer.start(1.0)


def unregister() -> None:
    """Stop polling. The job itself keeps running."""
    _poll_timer.stop()
    _search_timer.stop()
