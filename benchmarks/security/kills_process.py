"""Engine processes that are killed: when their work has begun, how they end, what they leave running. Linux only."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from engine.core.files import TEMPORARY_PREFIX

from ..places import ROOT

_MARK = "GAUSSIAN_HERITAGE_KILLS_MARK"
_PATIENCE = 600.0
"""Seconds after which a process that neither begins nor ends is a failure of its own."""
_ORPHAN_SECONDS = 5.0
"""Seconds within which processes that a killed one started must have ended."""


@dataclass
class EngineRun:
    """One process of the engine, with all events that it has printed so far.

    Attributes
    ----------
    process : subprocess.Popen
    events : list of dict
        Oldest first.
    mark : str
        Value of an environment variable that every process started by this one inherits.
    errors : Path
        File with its standard error.
    """

    process: subprocess.Popen[bytes]
    mark: str
    errors: Path
    events: list[dict[str, Any]] = field(default_factory=list)
    _reader: threading.Thread | None = None

    @classmethod
    def start(cls, arguments: Sequence[object], folder: Path, *, calibration: Path) -> EngineRun:
        """Start ``python -m engine`` with `arguments`; its files beside the project are written to `folder`."""
        mark = uuid.uuid4().hex
        errors = folder / f"errors-{mark}.txt"
        environment = {
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "GAUSSIAN_HERITAGE_CALIBRATION": str(calibration),
            _MARK: mark,
        }
        command = [sys.executable, "-m", "benchmarks.security.kills_engine", *map(str, arguments), "--events"]
        with errors.open("wb") as stream:
            process = subprocess.Popen(
                command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=stream, start_new_session=True
            )
        run = cls(process, mark, errors)
        run._reader = threading.Thread(target=run._read, daemon=True)
        run._reader.start()
        return run

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            # The last line of a killed process may be cut.
            if line.endswith(b"\n"):
                self.events.append(json.loads(line))

    def of_kind(self, kind: str) -> list[dict[str, Any]]:
        """Return the events of one kind."""
        return [event for event in list(self.events) if event["kind"] == kind]

    @property
    def stage(self) -> str:
        """The stage that was started last; empty before the first."""
        return next((event["stage"] for event in reversed(self.of_kind("stage_started"))), "")

    def wait_until_begun(self, stage: str) -> bool:
        """Wait until `stage` has started (empty: until the command has); return False if the process ended before."""

        def begun() -> bool:
            if stage:
                return any(event["stage"] == stage for event in self.of_kind("stage_started"))
            return _catches_sigterm(self.process.pid)

        return self._wait_for(begun)

    def _wait_for(self, condition: Callable[[], bool]) -> bool:
        end = time.monotonic() + _PATIENCE
        while not condition():
            if self.process.poll() is not None:
                return False
            if time.monotonic() > end:
                self.process.kill()
                raise TimeoutError(f"the engine did not begin within {_PATIENCE:.0f} s; its events: {self.events[-3:]}")
            time.sleep(0.001)
        return True

    def seconds_of(self, stage: str) -> float:
        """Wait for the end and return how long the work took that `wait_until_begun` had waited for."""
        begin = time.time()
        self.wait()
        times = [event["time"] for event in self.of_kind("stage_started") if not stage or event["stage"] == stage]
        if not stage:
            return time.time() - begin
        later = [event["time"] for event in self.of_kind("stage_started") if event["time"] > times[0]]
        return (later[0] if later else time.time()) - times[0]

    def wait(self) -> int:
        """Wait for the end and return the exit code; a process that never ends is killed, which gives -9."""
        try:
            code = self.process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        assert self._reader is not None
        # An orphan that holds the pipe open must not stop the harness; it is found as an orphan.
        self._reader.join(_ORPHAN_SECONDS)
        return code

    def orphans(self) -> list[str]:
        """Return the command lines of processes that this one started and that still run some seconds after its end."""
        end = time.monotonic() + _ORPHAN_SECONDS
        while (found := _marked(self.mark)) and time.monotonic() < end:
            time.sleep(0.05)
        for process in found:
            os.kill(process, signal.SIGKILL)
        return [f"process {process}" for process in found]


def _catches_sigterm(process: int) -> bool:
    """Return whether a process has a handler for SIGTERM: ours is set when a command begins."""
    try:
        status = Path(f"/proc/{process}/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    line = next((line for line in status.splitlines() if line.startswith("SigCgt:")), "SigCgt: 0")
    return bool(int(line.split()[1], 16) >> (signal.SIGTERM - 1) & 1)


def _marked(mark: str) -> list[int]:
    """Return the processes with the mark in their environment."""
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                if f"{_MARK}={mark}".encode() in (folder / "environ").read_bytes():
                    found.append(int(folder.name))
            except OSError:
                continue  # it ended meanwhile, or belongs to another user
    return found


def wait_for_write(project: Path, seconds: float, *, gone: Callable[[], bool]) -> None:
    """Return as soon as a file in `project` is being written, after `seconds`, or when `gone` returns True."""
    end = time.monotonic() + seconds
    while time.monotonic() < end and not gone():
        for _, _, files in os.walk(project):
            if any(file.startswith(TEMPORARY_PREFIX) for file in files):
                return
