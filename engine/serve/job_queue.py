"""Runs the engine for all users, as processes that outlive the server: one job after the other, or on a cluster.

A waiting job is a file; a running or ended one is a folder of its project, see `engine.workers.jobs`. The thread of the
queue polls the running jobs. After a restart of the server they are found again and the waiting ones follow. With a
Dask cluster, the process is ``remote``, which has the work done on a worker; Dask decides when and where.
"""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.engine_process import engine_command, engine_environment
from ..core.errors import HeritageError, ProjectError
from ..workers.jobs import Job, JobState, WaitingJob, WaitingJobs, seconds_left_in_all
from .feeds import Feeds
from .interrupted import interrupted_jobs
from .library import PROJECT, WebProject

_LOG = logging.getLogger(__name__)
_POLL_SECONDS = 0.2
_STOP_SECONDS = 30.0
"""Time that a job has to save its work when the server ends; compose.yaml allows for it."""
_ON_CLUSTER = 8
"""Jobs that a cluster gets at a time, each of another project: some 100 MB of memory each on the server."""
_KIND_NAMES = {
    "reconstruct": "Reconstruct the scene",
    "frames": "Take photos from {}",
    "segment": "Isolate the clicked object",
}
_OPTION_NAMES = {
    "--prompt": "Isolate {}",
    "--refine": "Correct {}",
    "--accept": "Isolate candidate {}",
    "--detail": "Add detail to {}",
}
"""What a job does by an option with a value, which is its subject."""
_FLAG_NAMES = {
    "--detail": "Add detail to all objects",
    "--all": "Find all objects",
    "--complement": "Isolate the background",
}
_STOPPED_SENTENCE = "What is computed so far is kept. Continue goes on from there."
_CHANGES = {"frames": ("photos",), "reconstruct": ("scene", "photos"), "segment": ("objects",)}
"""The parts of a project that a finished job of each kind has changed."""


@dataclass(frozen=True)
class JobView:
    """A job as clients see it; the fields are those of the API.

    ``label`` says what it does, with ``{}`` in the place of its ``subject``. A job in the state ``stopped`` without an
    `error` was stopped by the user.
    """

    id: str
    kind: str
    label: str
    subject: str
    state: str
    stage: str = ""
    fraction: float = 0.0
    seconds_left: float | None = None
    seconds_left_in_all: float | None = None
    message: str = ""
    warnings: tuple[str, ...] = ()
    error: str = ""
    curve: tuple[tuple[float, float], ...] = ()
    preview: bool = False
    objects: tuple[str, ...] = ()


class JobQueue:
    """The jobs of all projects of a server.

    Parameters
    ----------
    data : Path
        The server's data folder.
    feeds : Feeds
        Gets an event whenever a job changes.
    stop_jobs, scheduler
        See `ServeSettings`.
    """

    def __init__(self, data: Path, feeds: Feeds, *, stop_jobs: bool = False, scheduler: str = "") -> None:
        self._folder = data / "waiting"
        self._feeds = feeds
        self._stop_jobs = stop_jobs
        self._prefix = ["remote", f"--scheduler={scheduler}", "--events", "--"] if scheduler else []
        self._at_once = _ON_CLUSTER if scheduler else 1
        self._lock = threading.RLock()
        self._waiting = WaitingJobs(lambda: self._folder)
        self._last: dict[Path, Job] = {}
        self._not_started: dict[Path, JobView] = {}
        """Jobs that could not be started, until the next job of their project."""
        self._running: dict[Path, Job] = {}
        self._published: dict[tuple[Path, str], str] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="job queue", daemon=True)
        self._found = list(_jobs_in(data))

    def start(self) -> None:
        """Find the jobs of an earlier server, and begin to run what waits."""
        self._folder.mkdir(parents=True, exist_ok=True)
        for project, job in self._found:
            self._last[project] = job
        self._running = {job.folder: job for _, job in self._found if job.poll().running}
        self._waiting.find()
        for waiting in self._waiting:
            if self._was_started(waiting):
                self._waiting.drop(waiting)
        if self._stop_jobs:
            self._continue_interrupted()
        _LOG.info("%s jobs run, %s wait", len(self._running), len(self._waiting))
        self._thread.start()

    def stop(self) -> None:
        """End the thread. Running jobs go on, and the next server finds them; with `stop_jobs` they end too."""
        self._stop.set()
        self._thread.join()
        running = [job for job in self._running.values() if self._stop_jobs and job.poll().running]
        for job in running:
            job.cancel(_STOP_SECONDS)
        for job in running:
            job.wait()

    def submit(self, project: WebProject, arguments: Sequence[str]) -> JobView:
        """Run ``python -m engine`` with `arguments` on a project when its turn comes.

        Raises
        ------
        ProjectError
            When the same job is waiting already.
        DiskError
            When it cannot be stored.
        """
        with self._lock:
            waiting = self._waiting.add(arguments[0], project.folder, arguments)
            self._publish(project.folder)
            return _view_of_waiting(waiting)

    def waiting(self, project: Path) -> list[JobView]:
        """Return the waiting jobs of a project, the next first."""
        with self._lock:
            return [_view_of_waiting(one) for one in self._waiting if one.subject == project]

    def n_waiting(self, projects: set[Path]) -> int:
        """Return how many jobs of these projects wait."""
        with self._lock:
            return sum(one.subject in projects for one in self._waiting)

    def last(self, project: Path) -> JobView | None:
        """Return the running job of a project, or else the last one that ended."""
        with self._lock:
            if project in self._not_started:
                return self._not_started[project]
            job = self._last.get(project)
            return None if job is None else _view_of_job(job)

    def preview(self, project: Path) -> str:
        """Return the path of the newest picture of the training; empty before the first."""
        with self._lock:
            job = self._last.get(project)
            return "" if job is None else job.poll().preview

    def cancel(self, project: Path, job_id: str) -> None:
        """Stop the running job, or remove a waiting one.

        Raises
        ------
        ProjectError
            When it does not run or wait any more.
        """
        with self._lock:
            for waiting in self._waiting:
                if waiting.subject == project and waiting.file.stem == job_id:
                    self._waiting.drop(waiting)
                    self._publish(project)
                    return
            job = self._last.get(project)
            if job is None or job.folder.name != job_id or not job.poll().running:
                raise ProjectError("That job has ended already.")
            job.cancel()
            # Now, not when it has ended: the server may end in between, and the next one must not continue it.
            job.mark_taken()

    def cancel_all(self, project: Path) -> None:
        """Stop and remove everything that works on a project, and wait for its end."""
        with self._lock:
            for view in self.waiting(project):
                self.cancel(project, view.id)
            job = self._last.pop(project, None)
        if job is not None and job.poll().running:
            job.cancel()
            job.wait()

    def resume(self, project: WebProject, job_id: str) -> JobView:
        """Start a stopped job again; the engine continues with the work that is finished.

        Raises
        ------
        ProjectError
            When it is not the project's last job, or has not stopped.
        """
        with self._lock:
            job = self._last.get(project.folder)
            if job is None or job.folder.name != job_id or job.poll().running or not job.poll().error:
                raise ProjectError("That job cannot be continued.")
            return self.submit(project, _words(job.command))

    def _continue_interrupted(self) -> None:
        """Put the jobs that ended with an earlier server before those that wait."""
        place = 0
        for job in interrupted_jobs(self._found):
            again = job.kind, Path(job.subject), _words(job.command)
            if not self._waiting.has(*again):
                self._waiting.add(*again, place=place)
                place += 1
            job.mark_taken()

    def _run(self) -> None:
        while not self._stop.wait(_POLL_SECONDS):
            try:
                with self._lock:
                    self._step()
            except Exception:
                # The queue goes on with the other jobs; the log has the error.
                _LOG.exception("the queue failed")

    def _command(self, arguments: Sequence[str]) -> tuple[str, ...]:
        """Return the command line of a job: with `_words`, the only place that knows its form."""
        words = [*self._prefix, *arguments] if self._prefix else [*arguments, "--events"]
        return tuple(engine_command(*words))

    def _step(self) -> None:
        for job in list(self._running.values()):
            state = job.poll()
            project = _project_of(job)
            if not state.running:
                del self._running[job.folder]
                job.mark_taken()
                for kind in _CHANGES.get(job.kind, ()):
                    self._feeds.publish(project, kind)
            self._publish(project)
        busy = {_project_of(job) for job in self._running.values()}
        while len(self._running) < self._at_once and (waiting := self._waiting.next(busy)) is not None:
            busy.add(waiting.subject)
            self._start(waiting)

    def _start(self, waiting: WaitingJob) -> None:
        folder = waiting.subject / "jobs" / waiting.file.stem
        if waiting.file.exists() and waiting.subject.is_dir():
            try:
                job = Job.start(
                    # With this server's interpreter and scheduler: an earlier server may have had others.
                    self._command(_words(waiting.command)),
                    folder,
                    kind=waiting.kind,
                    subject=str(waiting.subject),
                    environment=engine_environment(),
                )
                self._running[folder] = self._last[waiting.subject] = job
                self._not_started.pop(waiting.subject, None)
            except HeritageError as error:
                _LOG.error("A job could not be started: %s", error)
                sentence = f"The job could not be started: {error}"
                view = replace(_view_of_waiting(waiting), state="stopped", error=sentence)
                self._not_started[waiting.subject] = view
        # After the start: a server that is killed in between starts no job twice, see `_was_started`.
        waiting.take()
        self._publish(waiting.subject)

    @staticmethod
    def _was_started(waiting: WaitingJob) -> bool:
        """Return whether an earlier server has started a job, or its project is gone."""
        return Job.attach(waiting.subject / "jobs" / waiting.file.stem) is not None or not waiting.subject.is_dir()

    def _publish(self, project: Path) -> None:
        """Send the state of a project's jobs to its watchers, if it has changed."""
        for kind, views in (("job", self.last(project)), ("waiting", self.waiting(project))):
            text = json.dumps(views, default=vars)
            if views is not None and self._published.get((project, kind)) != text:
                self._published[project, kind] = text
                self._feeds.publish(project, kind, text)


def _jobs_in(data: Path) -> Iterator[tuple[Path, Job]]:
    """Yield all jobs that have not been deleted, with the folders of their projects, the oldest of each first."""
    for jobs in sorted(data.glob("users/*/projects/*/jobs")):
        for folder in sorted(jobs.iterdir()):
            job = Job.attach(folder)
            if job is not None:
                yield jobs.parent, job


def _project_of(job: Job) -> Path:
    return job.folder.parent.parent


def _words(command: Sequence[str]) -> list[str]:
    """Return the engine's command and its arguments, of the command line of a job on this computer or on a cluster."""
    words = list(command[list(command).index("engine") + 1 :] if "engine" in command else command)
    if words[:1] == ["remote"]:
        return words[words.index("--") + 1 :]
    return [word for word in words if word != "--events"]


def _view_of_waiting(waiting: WaitingJob) -> JobView:
    return JobView(waiting.file.stem, waiting.kind, *_label(waiting.kind, _words(waiting.command)), "waiting")


def _view_of_job(job: Job) -> JobView:
    state = job.poll()
    label, subject = _label(job.kind, _words(job.command))
    return JobView(
        id=job.folder.name,
        kind=job.kind,
        label=label,
        subject=subject,
        state="running" if state.running else "finished" if state.finished else "stopped",
        stage=state.stage,
        fraction=state.fraction,
        seconds_left=state.seconds_left,
        seconds_left_in_all=_left_in_all(job, state),
        message=_STOPPED_SENTENCE if job.was_stopped() else state.message,
        warnings=tuple(state.warnings[-5:]),
        # A process that reported its error still has to end.
        error="" if state.running or job.was_stopped() else state.error,
        curve=tuple(state.curve),
        preview=bool(state.preview),
        objects=_objects_of(state),
    )


def _objects_of(state: JobState) -> tuple[str, ...]:
    """Return the ids of the objects that a job made, changed or found again."""
    found = state.outputs.get("objects", ())
    return tuple(map(str, found)) if isinstance(found, list) else ()


def _left_in_all(job: Job, state: JobState) -> float | None:
    """Return the time left for all stages; a job of one stage states its own."""
    if job.kind != "reconstruct":
        return state.seconds_left
    return seconds_left_in_all(Path(job.subject) / PROJECT, state)


def _label(kind: str, words: Sequence[str]) -> tuple[str, str]:
    """Return label and subject of a job."""
    for word in words if kind == "segment" else ():
        option, _, value = word.partition("=")
        if option in _OPTION_NAMES and value:
            return _OPTION_NAMES[option], value
        if option in _FLAG_NAMES:
            return _FLAG_NAMES[option], ""
    return _KIND_NAMES.get(kind, kind), Path(words[1]).name if kind == "frames" else ""
