"""The one engine job this Blender watches: started from operators, polled by one timer, followed up at its end."""

from __future__ import annotations

import contextlib
import hashlib
import logging
from collections.abc import Callable
from pathlib import Path

import bpy

from ..engine.errors import Cancelled, HeritageError, ProjectError
from .engine_process import engine_command
from .jobs import Job, JobState
from .model_files import states_from
from .preferences import current_environment, current_python, remember_models, user_folder
from .properties import choose, heritage_objects
from .scene_file import add_objects, open_project

__all__ = ["MODELS", "cancel", "current", "problem", "register", "start", "unregister"]

_LOG = logging.getLogger(__name__)
_INTERVAL = 0.5
MODELS = Path("model files")
"""Subject of jobs about model files, which belong to no project."""
_EDITING = "Leave Edit Mode (Tab): the engine is done, and its result waits to be shown."
_job: Job | None = None
_problem = ""


def current() -> tuple[Job, JobState] | None:
    """Return the job started or found last, and its state."""
    return None if _job is None else (_job, _job.poll())


def problem() -> str:
    """Return what went wrong when a finished job's results were brought into the scene; mostly empty."""
    return _problem


def start(kind: str, subject: Path, *arguments: str) -> JobState | None:
    """Run the engine with `arguments`; in background mode wait for it and follow up, else return at once.

    Parameters
    ----------
    kind : str
        ``"reconstruct"`` and ``"segment"`` are followed up by an import, ``"models"`` by the preferences.
    subject : Path
        Project folder, or `MODELS`.
    arguments
        Command and arguments of the engine.

    Returns
    -------
    JobState or None
        None where the job goes on while Blender is used.

    Raises
    ------
    HeritageError
        When there is no interpreter, another job runs, or (in background mode) the job failed.
    """
    global _job, _problem
    running = current()
    if running is not None and running[1].running:
        raise ProjectError(f"A job is still working on {running[0].subject}. Wait for it or cancel it first.")
    if _problem == _EDITING:
        raise ProjectError(_EDITING)
    key = hashlib.sha256(f"{kind} {subject}".encode()).hexdigest()[:16]
    _job, _problem = (
        Job.start(
            engine_command(current_python(), *arguments),
            user_folder("jobs") / key,
            kind=kind,
            subject=str(subject),
            environment=current_environment(),
        ),
        "",
    )
    if bpy.app.background:
        state = _job.wait()
        if state.error:
            raise HeritageError(state.error)
        _follow_up(_job, state)
        return state
    _watch()
    return None


def cancel() -> None:
    """Ask the current job to stop; `Cancelled` when there is none."""
    running = current()
    if running is None or not running[1].running:
        raise Cancelled("No job is running.")
    running[0].cancel()


def _watch() -> None:
    if not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=_INTERVAL, persistent=True)


def _tick() -> float | None:
    global _problem
    if _job is None:
        return None
    state = _job.poll()
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("VIEW_3D", "PREFERENCES"):
                area.tag_redraw()
    if state.running:
        return _INTERVAL
    if state.finished:
        if _job.kind != "models" and _is_editing():
            _problem = _EDITING
            return _INTERVAL
        _problem = ""
        try:
            _follow_up(_job, state)
            # A result that arrives by itself is still one step to undo; one that changes nothing here adds none.
            bpy.ops.ed.undo_push(message=f"Heritage {_job.kind}")
        except HeritageError as error:
            _problem = str(error)
    return None


def _is_editing() -> bool:
    """Return whether splats are in Edit Mode, where Blender lets nobody else change a mesh."""
    return any(obj.mode == "EDIT" for scene in bpy.data.scenes for obj in heritage_objects(scene))


def _follow_up(job: Job, state: JobState) -> None:
    action = _FOLLOW_UPS.get(job.kind)
    if action is not None:
        action(Path(job.subject), state)


def _after_reconstruct(project: Path, state: JobState) -> None:
    open_project(bpy.context.scene, project)


def _after_segment(project: Path, state: JobState) -> None:
    scene = next((one for one in bpy.data.scenes if one.heritage.project == str(project)), bpy.context.scene)
    made = state.outputs["objects"]
    there = {obj.heritage.object_id for obj in heritage_objects(scene, "OBJECT")}
    # What "find all" found again need not be in this file.
    add_objects(scene, project, [*made, *(one for one in state.outputs.get("kept", ()) if one not in there)])
    scene.heritage.show = "OBJECTS"
    choose(scene, made[0])


def _after_models(subject: Path, state: JobState) -> None:
    remember_models(states_from(state.outputs))


_FOLLOW_UPS: dict[str, Callable[[Path, JobState], None]] = {
    "reconstruct": _after_reconstruct,
    "segment": _after_segment,
    "models": _after_models,
}


def _find_running_job() -> None:
    """Watch a job again that went on while Blender was closed."""
    global _job
    if _job is None:
        for folder in sorted(user_folder("jobs").iterdir()):
            job = Job.attach(folder)
            if job is not None and job.poll().running:
                _LOG.info("found a running job on %s", job.subject)
                _job = job
                _watch()
                return


def register() -> None:
    """Look for a job of an earlier session, once Blender has started."""
    if not bpy.app.background:
        bpy.app.timers.register(_find_running_job, first_interval=1.0)


def unregister() -> None:
    """Stop watching; the job itself goes on."""
    for timer in (_tick, _find_running_job):
        with contextlib.suppress(ValueError):
            bpy.app.timers.unregister(timer)
