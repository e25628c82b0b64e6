"""Engine jobs: start, poll without blocking, cancel, and attach again after Blender was closed. Does not import bpy.

A job has a folder with ``job.json`` (its process and command), ``events.jsonl`` (the engine's standard output) and
``errors.txt`` (its standard error). It writes to files instead of pipes and runs in its own session, so that it
continues when Blender ends.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..engine import events
from ..engine.errors import DiskError, ProjectError
from ..engine.files import write_json

__all__ = ["Job", "JobState"]

_LOG = logging.getLogger(__name__)
_JOB, _EVENTS, _ERRORS = "job.json", "events.jsonl", "errors.txt"
_LOG_INTERVAL = 15.0
"""Seconds between two log lines about the same stage."""


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
        Wall seconds of training, and PSNR of the held-out photos in dB.
    warnings : list of str
    error : str
        One sentence if the job failed or was cancelled, else empty.
    finished : bool
        Whether the job ended successfully.
    outputs : dict
        Results of the job, see `engine.events.Finished`.
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
    finished: bool = False
    outputs: dict[str, Any] = field(default_factory=dict)

    def progress_line(self) -> str:
        """Return the stage, its progress and the time left, as a line of text."""
        left = "" if self.seconds_left is None else f", {_format_seconds(self.seconds_left)} left"
        return f"{self.stage} {self.fraction:.0%}{left}"

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
                self.metrics[event.name] = event.value
                if event.name == "psnr" and event.seconds is not None:
                    self.curve.append((event.seconds, event.value))
            case events.Preview():
                self.preview = event.path
            case events.Warned():
                self.warnings.append(event.message)
            case events.ErrorEvent():
                self.error = event.message
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

    def __init__(self, folder: Path, record: Mapping[str, Any], process: subprocess.Popen[bytes] | None) -> None:
        self.folder = folder
        self.kind: str = record["kind"]
        self.subject: str = record["subject"]
        self._pid: int = record["pid"]
        self._command: list[str] = record["command"]
        self._process = process
        self._state = JobState()
        self._offset = 0
        self._kill_at: float | None = None

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
        own_group: dict[str, Any] = {"start_new_session": True}
        if sys.platform == "win32":
            own_group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / _JOB).unlink(missing_ok=True)
            with (folder / _EVENTS).open("wb") as output, (folder / _ERRORS).open("wb") as errors:
                process = subprocess.Popen(
                    list(command),
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=errors,
                    env=dict(environment),
                    cwd=folder,
                    **own_group,
                )
        except OSError as error:
            raise DiskError(
                f"{command[0]} could not be started in {folder}: {error.strerror or error}. Check both paths."
            ) from error
        record = {"kind": kind, "subject": subject, "pid": process.pid, "command": list(command)}
        write_json(folder / _JOB, record)
        return cls(folder, record, process)

    @classmethod
    def attach(cls, folder: Path) -> Job | None:
        """Return the job whose files are in `folder`, running or ended; None when there is none."""
        try:
            record = json.loads((folder / _JOB).read_text(encoding="utf-8"))
            return cls(folder, record, None)
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def poll(self) -> JobState:
        """Read new events without blocking, and return the state.

        Notes
        -----
        This also kills a cancelled job whose grace period is over.
        """
        if not self._state.running:
            return self._state
        alive = self._is_alive()
        # Checked before reading, so that everything a process wrote before it ended is read.
        self._read_events()
        if alive and self._kill_at is not None and time.monotonic() > self._kill_at:
            self._signal(kill=True)
            self._kill_at = None
        if not alive:
            self._state.running = False
            if not self._state.finished and not self._state.error:
                self._state.error = self._unexpected_exit_message()
            self._state.finished = self._state.finished and not self._state.error
        return self._state

    def cancel(self, grace_seconds: float = 10.0) -> None:
        """Interrupt the job, and let `poll` kill it if it still runs after `grace_seconds`."""
        if self.poll().running:
            self._signal(kill=False)
            self._kill_at = time.monotonic() + grace_seconds

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

    def _read_events(self) -> None:
        try:
            with (self.folder / _EVENTS).open("rb") as stream:
                stream.seek(self._offset)
                data = stream.read()
        except OSError:
            return  # The next poll tries again. A job whose folder was deleted ends with its process.
        complete = data.rfind(b"\n") + 1
        self._offset += complete
        for line in data[:complete].decode("utf-8", "replace").splitlines():
            event = events.from_json_line(line)
            if event is not None:
                self._state.update(event)

    def _unexpected_exit_message(self) -> str:
        """Return the error message for a process that ended without a final event, e.g. because it crashed."""
        code = f" (exit code {self._process.returncode})" if self._process is not None else ""
        try:
            lines = (self.folder / _ERRORS).read_text(encoding="utf-8", errors="replace").strip().splitlines()
        except OSError:
            lines = []
        last_line = f" Its last line was: {lines[-1].strip()}" if lines else ""
        return (
            f"The engine stopped unexpectedly{code}.{last_line} Finished work is kept. "
            f"Details are in {self.folder / _ERRORS}."
        )

    def _is_alive(self) -> bool:
        if self._process is not None:
            return self._process.poll() is None
        return _process_runs(self._pid, self._command)

    def _signal(self, *, kill: bool) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            if sys.platform == "win32":
                os.kill(self._pid, signal.SIGTERM if kill else signal.CTRL_BREAK_EVENT)
            else:
                # The whole process group: a stage may have started subprocesses.
                os.killpg(self._pid, signal.SIGKILL if kill else signal.SIGINT)


def _format_seconds(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"


def _process_runs(pid: int, command: Sequence[str]) -> bool:
    """Return whether process `pid` runs `command`: the system may have given the number to another program since."""
    if sys.platform == "win32":
        listing = ["tasklist", "/FI", f"PID eq {pid}", "/NH"]
        expected = str(pid)
    else:
        listing = ["ps", "-ww", "-o", "stat=,args=", "-p", str(pid)]
        expected = " ".join(command[1:])
    output = subprocess.run(listing, capture_output=True, text=True, errors="replace", check=False).stdout
    return expected in output and not output.lstrip().startswith("Z")
