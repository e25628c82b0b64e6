"""Runs engine jobs one after the other: operators start them, a timer polls them, and their results are imported.

Blender may be closed meanwhile. The running job is found again after that, and so are jobs that ended in the meantime;
their results are offered where no scene of the file shows their project. Jobs that were still waiting start then.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
from collections.abc import Sequence
from pathlib import Path

import bpy

from ...engine.core.errors import Cancelled, HeritageError, ProjectError
from ...engine.project.content import is_project
from ...engine.workers.jobs import Job, JobState, WaitingJob, WaitingJobs
from ..blender import problems
from ..blender.guards import Timer, add_load_handler, redraw
from ..project.first_view import show_job, show_scene
from ..project.project_history import catch_up
from ..setup.engine_process import engine_command
from ..setup.installation import installed_engine
from ..setup.preferences import current_environment, current_python, store_set_up_problem, user_folder
from ..splats.properties import project_of
from .job_names import stores_edits
from .results import PROJECT_KINDS, destination, import_results, is_editing, scene_for

_LOG = logging.getLogger(__name__)
_POLL_INTERVAL = 0.5
"""Seconds between two polls of the job."""
MODEL_FILES = Path("model files")
"""Subject of jobs about model files, which belong to no project."""
ENGINE = Path("the engine")
"""Subject of jobs about the engine itself."""
REMOVAL = "remove engine"
"""Kind of the job that deletes the engine."""
_EDIT_MODE_MESSAGE = "Leave Edit Mode (Tab) to import the finished result."


_job: Job | None = None
_queue = WaitingJobs(lambda: user_folder("waiting jobs"))
_found: list[Job] = []
"""Jobs of an earlier session of Blender that are still to be polled."""
_undecided: list[Job] = []
"""Finished jobs whose results fit no scene of this file, so that the user decides."""
_stopped: list[Job] = []
"""Jobs of projects that ended before their work was done, until the user continues or leaves them."""
_file_number = 0
"""Grows with each .blend file that is loaded."""
_seen_in_file: dict[Path, int] = {}
"""By folder of a job: the number of the file that was loaded when it was started or found."""
_waits_for_object_mode = False


def current() -> tuple[Job, JobState] | None:
    """Return the last job and its state, or None."""
    return None if _job is None else (_job, _job.poll())


def waiting() -> list[WaitingJob]:
    """Return the jobs that wait for the running one."""
    return list(_queue)


def stopped(scene: bpy.types.Scene) -> list[tuple[int, Job, JobState]]:
    """Return the stopped jobs that belong to `scene`, with their numbers, the last first."""
    found = [(number, job, job.poll()) for number, job in enumerate(_stopped) if belongs_to(job, scene)]
    return found[::-1]


def belongs_to(job: Job, scene: bpy.types.Scene) -> bool:
    """Return whether `scene` is where the user looks for a job: it shows its project, or none in the same file.

    A job that belongs to no project is shown everywhere.
    """
    if job.kind not in PROJECT_KINDS:
        return True
    if not scene.heritage.project:
        return _seen_in_file.get(job.folder) == _file_number
    with contextlib.suppress(HeritageError):  # A path that no project can have; the panel says so.
        return project_of(scene.heritage) == Path(job.subject)
    return False


def undecided() -> list[Path]:
    """Return the projects with a finished result that fits no scene of this file."""
    return [Path(job.subject) for job in _undecided]


def ended_while_away(number: int) -> bool:
    """Return whether an earlier session of Blender started the job of a result of `undecided`."""
    return _undecided[number].of_earlier_session


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
    """Run a program that writes events, after the running job. In background mode, wait for it and import its results.

    Parameters
    ----------
    kind : str
        ``"reconstruct"``, ``"segment"``, ``"models"``, ``"doctor"``, ``"set-up"`` or `REMOVAL`. It determines what is
        done with the results.
    subject : Path
        Project folder, `MODEL_FILES` or `ENGINE`.

    Returns
    -------
    JobState or None
        Final state in background mode. None otherwise: the job runs while Blender is used.

    Raises
    ------
    HeritageError
        When the same job is waiting already, or (in background mode) the job failed.
    """
    if problem():
        raise ProjectError(problem())
    if _is_running():
        _queue.add(kind, subject, command)
        _poll_timer.start(_POLL_INTERVAL, persistent=True)
        return None
    job = _launch(kind, subject, command)
    if bpy.app.background:
        state = job.wait()
        job.mark_taken()
        if kind == "set-up":
            store_set_up_problem(state.error)
        if state.error:
            raise HeritageError(state.error)
        import_results(job, state, scene_for(subject))
        catch_up()
        return state
    show_job()
    _poll_timer.start(_POLL_INTERVAL, persistent=True)
    return None


def drop(number: int) -> None:
    """Remove a waiting job by its number in `waiting`.

    Raises
    ------
    ProjectError
        When there is no such job.
    """
    if not 0 <= number < len(_queue):
        raise ProjectError("That job is no longer waiting.")
    _queue.drop(waiting()[number])


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


def continue_stopped(number: int) -> None:
    """Start a stopped job again, with the same command; the engine continues with the work that is finished.

    While another job runs, it waits for that one.

    Parameters
    ----------
    number : int
        Number of the job in `stopped`.

    Raises
    ------
    HeritageError
        When there is no such job, or it cannot be started.
    """
    job = _stopped_job(number)
    if job.kind == "segment" and not is_project(Path(job.subject)):
        raise ProjectError(
            f"The project {job.subject} is missing, so its job cannot continue. Choose where it is now with Find "
            "Project, then start the job again."
        )
    start_command(job.kind, Path(job.subject), job.command)
    # Only now: until then, an error leaves the job where the user can continue it.
    _no_longer_stopped(job)


def leave_stopped(number: int) -> None:
    """Do not offer to continue a stopped job any more; its finished work stays in the project.

    Raises
    ------
    ProjectError
        When there is no such job.
    """
    _no_longer_stopped(_stopped_job(number))


def _stopped_job(number: int) -> Job:
    if not 0 <= number < len(_stopped):
        raise ProjectError("There is no stopped job to continue.")
    return _stopped[number]


def _no_longer_stopped(job: Job) -> None:
    if job in _stopped:
        _stopped.remove(job)
        job.mark_taken()


def _is_continued_by(job: Job, kind: str, subject: Path, command: Sequence[str]) -> bool:
    """Return whether a new job does what a stopped one left undone."""
    is_same = (job.kind, job.subject) == (kind, str(subject))
    # Photos are reconstructed into a project once, whatever the options: the import resumes. All that is not stored is
    # stored at once, as it is now; what was to be stored before must not come back after it.
    is_whole = kind == "reconstruct" or (stores_edits(command) and stores_edits(job.command))
    return is_same and (is_whole or job.command == list(command))


def take_in(number: int) -> None:
    """Open the result of a project of `undecided` in the scene that it fits, or else in a new one, and look at it.

    Raises
    ------
    HeritageError
        When there is no such result, or it cannot be imported.
    """
    job = _undecided_job(number)
    scene = scene_for(Path(job.subject))
    if bpy.context.window is not None:
        bpy.context.window.scene = scene
    _import(job, job.poll(), scene)


def dismiss(number: int) -> None:
    """Do not ask about a result of `undecided` any more; it stays in its project.

    Raises
    ------
    ProjectError
        When there is no such result.
    """
    _undecided_job(number).mark_taken()


def _undecided_job(number: int) -> Job:
    if not 0 <= number < len(_undecided):
        raise ProjectError("That result was opened or left already.")
    return _undecided.pop(number)


def _is_running() -> bool:
    running = current()
    return running is not None and running[1].running


def _launch(kind: str, subject: Path, command: Sequence[str]) -> Job:
    global _job
    folder = _folder_for(kind, subject)
    _job = Job.start(
        list(command),
        folder,
        kind=kind,
        subject=str(subject),
        environment=current_environment(),
    )
    _seen_in_file[folder] = _file_number
    for job in [one for one in _stopped if _is_continued_by(one, kind, subject, command)]:
        _no_longer_stopped(job)
    return _job


def _folder_for(kind: str, subject: Path) -> Path:
    """Return a folder for a job: that of the same running job, which `Job.start` refuses, or one that is free.

    A job whose end the user does not know yet keeps its folder.
    """
    if kind == REMOVAL:
        # It goes on when the add-on is uninstalled, and Windows deletes no folder that a process works in.
        return installed_engine().removal_folder
    key = hashlib.sha256(f"{kind} {subject}".encode()).hexdigest()[:16]
    folder, number = user_folder("jobs") / key, 0
    while (job := Job.attach(folder)) is not None and not job.is_taken() and not job.poll().running:
        number += 1
        folder = folder.with_name(f"{key}-{number}")
    return folder


def _poll_job() -> float | None:
    global _waits_for_object_mode
    if _job is None:
        return None
    ended, state = _job, _job.poll()
    redraw()
    if state.running:
        return _POLL_INTERVAL
    _waits_for_object_mode = state.finished and ended.kind in PROJECT_KINDS and is_editing()
    if _waits_for_object_mode:
        return _POLL_INTERVAL
    # The next job starts whatever becomes of this result, but after it, as it may work on the same project.
    try:
        _take_end(ended, state)
    except Exception as error:
        problems.show(problems.sentence_of(error))
    _poll_next()
    if _job is ended:
        return None
    if state.error and ended not in _stopped and state.error_type != "PromptError":
        # The panels show the next job already. They show stopped jobs, and a refusal with its candidates, all the same.
        problems.show(f"{Path(ended.subject).name}: {problems.plain_text(state.error)}")
    return _POLL_INTERVAL


def _take_end(job: Job, state: JobState) -> None:
    """Import the result of a job that has ended, or ask where it belongs."""
    if job.kind == "set-up":
        store_set_up_problem(state.error)
    if job.is_taken():
        return
    if not state.finished:
        if job.kind in PROJECT_KINDS and state.error_type != "PromptError":
            # Not taken: it can be continued also after Blender was closed.
            _stopped.append(job)
        else:
            job.mark_taken()
        return
    if job.kind not in PROJECT_KINDS:
        _import(job, state, bpy.context.scene)
        return
    # The scene that Blender starts with is not the one that an earlier session worked on.
    scene = destination(Path(job.subject), only_if_shown=job.of_earlier_session)
    if scene is None:
        _undecided.append(job)
    else:
        _import(job, state, scene)


def _poll_next() -> None:
    """Make the next job current: one that was found, or else one that waits and can be started."""
    global _job
    if _found:
        _job = _found.pop(0)
        return
    while (waiting_job := _queue.next()) is not None:
        try:
            if waiting_job.take():
                _launch(waiting_job.kind, waiting_job.subject, waiting_job.command)
                return
        except HeritageError as error:
            problems.show(problems.sentence_of(error))


def _import(job: Job, state: JobState, scene: bpy.types.Scene) -> None:
    # Before the import: a result that cannot be imported is reported once, and not again after each start of Blender.
    job.mark_taken()
    import_results(job, state, scene)
    if job.kind in PROJECT_KINDS:
        if job.kind == "reconstruct" and scene == bpy.context.scene:
            show_scene(scene)
        # An import by the timer is one undo step. Blender adds none if nothing changed.
        bpy.ops.ed.undo_push(message=f"Heritage {job.kind}")
        # What was undone or renamed while the job worked in the project.
        catch_up()


def _find_jobs() -> None:
    """Continue with jobs of an earlier session of Blender. Only folders that we made are searched."""
    if _job is not None or _found:
        return
    folders = [*sorted(user_folder("jobs").iterdir()), installed_engine().removal_folder]
    jobs = [job for folder in folders if (job := Job.attach(folder)) is not None]
    known_folders = {job.folder for job in (*_stopped, *_undecided)}
    _found.extend(job for job in jobs if not job.is_taken() and job.folder not in known_folders)
    _seen_in_file.update((job.folder, _file_number) for job in _found)
    _queue.find()
    if _found or _queue:
        _LOG.info("found %s jobs of an earlier session, and %s that wait", len(_found), len(_queue))
        _poll_next()
        _poll_timer.start(_POLL_INTERVAL, persistent=True)


_poll_timer = Timer(_poll_job)
_search_timer = Timer(_find_jobs)


def _search() -> None:
    """Search once Blender has loaded a file."""
    _search_timer.start(0.5, persistent=True)


def _after_loading() -> None:
    """Forget the messages about the former file, and search for jobs."""
    global _file_number
    _file_number += 1
    problems.clear()
    _search()


def register() -> None:
    """Search for jobs of an earlier session, now and after each file that is loaded. The end of Blender ends no job."""
    if not bpy.app.background:
        _search()
        add_load_handler(_after_loading)
