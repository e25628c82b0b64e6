"""Engine jobs: start, poll without blocking, cancel, and attach again after Blender was closed. Does not import bpy.

A job has a folder with ``job.json`` (its process and command), ``events.jsonl`` (the engine's standard output) and
``errors.txt`` (its standard error); a file ``taken`` says that the user has seen its end, a file ``stop`` asks it to
stop. It writes to files instead of pipes and runs in a group of its own, so that it continues when Blender ends.
"""

from __future__ import annotations

import io
import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...core import events
from ...core.engine_process import ERRORS_FILE, EVENTS_FILE, STOP_FILE, EngineProcess, events_in
from ...core.errors import Cancelled, DiskError, EnvironmentProblem, FormatError, ProjectError
from ...core.files import atomic_write, delete_derived, opened, optional, path_within, read_json, write_json

_LOG = logging.getLogger(__name__)
_JOB, _TAKEN = "job.json", "taken"
_RECORD = {"kind": str, "subject": str, "pid": int, "command": [str], "started": optional((int, None))}
_MAX_PID = 1 << 31
STOP_SECONDS = 10.0
"""Time that a job has to save its work after it was asked to stop; then it is killed."""
_LOG_INTERVAL = 15.0
"""Seconds between two log lines about the same stage."""
_MAX_READ = 1 << 20
"""Bytes of events that one poll reads, because Blender waits for it. Longer lines are skipped."""
_MAX_KEPT = 4096
"""Warnings, metrics and points of the curve that are kept, each."""


@dataclass
class JobState:
    """State of a job. Each `Job.poll` updates the same object.

    Attributes
    ----------
    running : bool
        Whether the process is alive.
    stage : str
        Name of the current stage.
    fraction : float
        Progress of the stage, 0 to 1.
    seconds_left : float or None
        Estimated time left for the stage.
    message : str
        Last message.
    preview : str
        Path of the newest preview image; empty before the first.
    metrics : dict
        Last value of each metric, e.g. ``psnr``.
    curve : list of (float, float)
        Wall seconds of training, and PSNR of the test photos in dB.
    warnings : list of str
    error : str
        One sentence if the job failed or was cancelled, else empty.
    error_type : str
        Name of the engine's exception; empty when the engine named none.
    finished : bool
        Whether the job ended successfully.
    outputs : dict
        Results of the job, see `engine.core.events.Finished`.
    """

    running: bool = True
    stage: str = ""
    fraction: float = 0.0
    seconds_left: float | None = None
    message: str = ""
    preview: str = ""
    metrics: dict[str, float] = field(default_factory=dict)
    curve: list[tuple[float, float]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    error: str = ""
    error_type: str = ""
    finished: bool = False
    outputs: dict[str, Any] = field(default_factory=dict)

    def progress_line(self) -> str:
        """Return the stage, its progress, the time left and the last message, as a line of text."""
        left = "" if self.seconds_left is None else f", {format_seconds(self.seconds_left)} left"
        said = f": {self.message}" if self.message else ""
        return f"{self.stage} {self.fraction:.0%}{left}{said}"

    def update(self, event: events.Event) -> None:
        """Update the state with `event`."""
        match event:
            case events.StageStarted():
                self.stage, self.fraction, self.seconds_left, self.message = event.stage, 0.0, None, ""
            case events.Progress():
                self.stage, self.fraction = event.stage, min(max(event.fraction, 0.0), 1.0)
                self.seconds_left, self.message = event.seconds_left, event.message or self.message
            case events.StageFinished():
                self.fraction, self.seconds_left = 1.0, 0.0
            case events.Metric():
                if event.name in self.metrics or len(self.metrics) < _MAX_KEPT:
                    self.metrics[event.name] = event.value
                if event.name == "psnr" and event.seconds is not None:
                    self.curve.append((event.seconds, event.value))
                    if len(self.curve) > _MAX_KEPT:
                        del self.curve[1::2]
            case events.Preview():
                self.preview = event.path
            case events.Warned():
                self.warnings.append(event.message)
                del self.warnings[:-_MAX_KEPT]
            case events.ErrorEvent():
                self.error, self.error_type = event.message, event.error
            case events.Finished():
                self.finished, self.message, self.outputs = True, event.message, event.outputs


class Job:
    """One engine process. Create it with `start` or `attach`.

    Attributes
    ----------
    folder : Path
        Folder of the job's files.
    kind : str
        Purpose of the job. It determines what the add-on does with the results.
    subject : str
        What the job works on, usually the project folder.
    """

    def __init__(self, folder: Path, kind: str, subject: str, process: EngineProcess) -> None:
        self.folder, self.kind, self.subject = folder, kind, subject
        self._process = process
        self._state = JobState()
        self._offset = 0
        self._skips_line = False

    @property
    def command(self) -> list[str]:
        """Its command line."""
        return self._process.command

    @classmethod
    def start(
        cls, command: Sequence[str], folder: Path, *, kind: str, subject: str, environment: Mapping[str, str]
    ) -> Job:
        """Start `command` and return immediately.

        Parameters
        ----------
        command : sequence of str
            Command line of a process that writes event lines to its standard output.
        folder : Path
            Folder of the job's files. Files of an earlier job are replaced.
        kind, subject : str
            See the class.
        environment : mapping
            Environment variables of the process.

        Raises
        ------
        ProjectError
            When an earlier job with this folder is still running.
        DiskError
            When the folder cannot be written, or the command cannot be started.
        """
        earlier = cls.attach(folder)
        if earlier is not None and earlier.poll().running:
            raise ProjectError(f"A job is still working on {earlier.subject}. Wait for it or cancel it first.")
        try:
            folder.mkdir(parents=True, exist_ok=True)
            # Opening them would follow a link.
            for name in (_JOB, _TAKEN, EVENTS_FILE, ERRORS_FILE, STOP_FILE):
                delete_derived(folder, name)
        except OSError as error:
            raise DiskError(f"{folder} cannot be written: {error.strerror or error}. Check the disk.") from error
        process = EngineProcess.start_apart(command, environment, folder)
        record = {
            "kind": kind, "subject": subject, "pid": process.pid, "command": process.command,
            "started": process.started,
        }  # fmt: skip
        try:
            write_json(folder / _JOB, record)
        except DiskError:
            # Nobody would find it again.
            process.kill()
            raise
        return cls(folder, kind, subject, process)

    @classmethod
    def attach(cls, folder: Path) -> Job | None:
        """Return the job whose files are in `folder`, running or ended; None when there is none.

        Parameters
        ----------
        folder : Path
            A folder of `start`. One that is a link elsewhere, or whose ``job.json`` is, holds no job of ours.
        """
        try:
            file = path_within(folder.parent, folder.name, _JOB)
            record = read_json(file, _RECORD, advice="Delete it.")
        except FormatError:
            return None
        # 0 and negative numbers stand for groups of processes, 1 for the first process of the system.
        if not 1 < record["pid"] < _MAX_PID or not record["command"]:
            return None
        process = EngineProcess(record["pid"], record["command"], record.get("started"), folder)
        return cls(folder, record["kind"], record["subject"], process)

    def poll(self) -> JobState:
        """Read new events without blocking, and return the state.

        Notes
        -----
        This also kills a cancelled job whose grace period is over.
        """
        if not self._state.running:
            return self._state
        # Checked before reading, so that everything a process wrote before it ended is read.
        alive = self._process.poll()
        all_read = self._read_events()
        if not alive and all_read:
            self._state.running = False
            if not self._state.finished and not self._state.error:
                self._state.error = self._unexpected_exit_message()
            self._state.finished = self._state.finished and not self._state.error
        return self._state

    @property
    def of_earlier_session(self) -> bool:
        """Whether another session of Blender started the job."""
        return self._process.is_found_again

    def mark_taken(self) -> None:
        """Record that the user knows how the job ended, so that it is not reported again after Blender was closed.

        Raises
        ------
        DiskError
            When the folder cannot be written.
        """
        with atomic_write(self.folder / _TAKEN):
            pass

    def is_taken(self) -> bool:
        """Return whether the user knows how the job ended."""
        return (self.folder / _TAKEN).exists()

    def cancel(self, grace_seconds: float = STOP_SECONDS) -> None:
        """Ask the job to stop at its next safe point, and let `poll` kill it if it still runs after `grace_seconds`.

        Raises
        ------
        DiskError
            When the folder of the job cannot be written.
        EnvironmentProblem
            When the system does not report whether the process is still this job, so that it cannot be killed.
        """
        if self.poll().running:
            self._process.stop()
            if self._process.runs() is None:
                raise EnvironmentProblem(
                    f"The job on {self.subject} was asked to stop. The system does not report whether process "
                    f"{self._process.pid} is still this job: if it goes on, end it with the system's own tools."
                )
            self._process.kill_after(grace_seconds)

    def was_ended(self) -> bool:
        """Return whether the job was ended from outside, by a request or a signal, and not by an error of its own."""
        state = self.poll()
        return not state.running and not state.finished and state.error_type in ("", Cancelled.__name__)

    def was_stopped(self) -> bool:
        """Return whether the job ended because it was asked to, also where it had to be killed then."""
        is_asked = self._state.error_type == Cancelled.__name__ or (self.folder / STOP_FILE).exists()
        return self.was_ended() and is_asked

    def wait(self, interval: float = 0.05) -> JobState:
        """Poll until the job has ended, and log its progress. Blocks: for background mode only."""
        stage, logged_at = "", 0.0
        while self.poll().running:
            state = self._state
            if state.stage and (state.stage != stage or time.monotonic() - logged_at > _LOG_INTERVAL):
                stage, logged_at = state.stage, time.monotonic()
                _LOG.info("%s", state.progress_line())
            time.sleep(interval)
        return self._state

    def _read_events(self) -> bool:
        """Read some of the new events, and return whether there are no more."""
        try:
            with opened(self.folder / EVENTS_FILE, advice="") as stream:
                stream.seek(self._offset)
                data = stream.read(_MAX_READ)
        except FormatError:
            return True  # The next poll tries again. A job whose folder was deleted ends with its process.
        if self._skips_line:
            complete = data.find(b"\n") + 1
            self._skips_line = not complete
            all_read = not complete and len(data) < _MAX_READ
        else:
            complete = data.rfind(b"\n") + 1
            for event in events_in(io.BytesIO(data[:complete])):
                self._state.update(event)
            self._skips_line = not complete and len(data) == _MAX_READ
            all_read = len(data) < _MAX_READ
        self._offset += len(data) if self._skips_line else complete
        return all_read

    def _unexpected_exit_message(self) -> str:
        """Return the error message for a process that ended without a final event, e.g. because it crashed."""
        code = "" if self._process.code is None else f" (exit code {self._process.code})"
        last_line = self._process.last_complaint()
        shown = f" Its last line was: {last_line}" if last_line else ""
        return (
            f"The engine stopped unexpectedly{code}.{shown} Finished work is kept. Details are in "
            f"{self.folder / ERRORS_FILE}."
        )


def format_seconds(seconds: float) -> str:
    """Return a time as text, in seconds or minutes."""
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
