"""The engine as a child process of a worker: followed by its events, stopped on request, never left behind.

A child that needs too much memory is killed alone. It ends when its worker dies, so that the worker that repeats the
stage finds the project unlocked.
"""

from __future__ import annotations

import contextlib
import os
import runpy
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from ...core.engine_process import engine_command, engine_environment, events_in
from ...core.errors import DiskError
from ...core.events import Event, Metric, StageFinished, to_json_line
from ...core.system import (
    STOP_VARIABLE,
    cpu_seconds,
    end_children_with_this_process,
    end_with_parent,
    json_printable,
    kill_group,
    no_core_dumps,
    own_group,
    request_stop,
    use_cores,
)
from ..jobs import JobState

__all__ = ["CORES_VARIABLE", "EngineProcess"]

CORES_VARIABLE = "GAUSSIAN_HERITAGE_CORES"
"""Environment variable of a worker: numbers of the cores that its engines use, e.g. ``0,1``; by default all."""

_MODULE = f"{__package__}.engine_process"
_CPU_SECONDS = "process_cpu_seconds"
_STOP = "stop"
_KEPT_ERRORS = 4096


@dataclass(eq=False)
class EngineProcess:
    """One engine that runs now or has ended.

    Attributes
    ----------
    process : subprocess.Popen
    state : JobState
        What its events say so far.
    computed, kept : list of str
        Stages that it computed, and those that were done already.
    stopped : bool
        Whether `stop` was called.
    """

    process: subprocess.Popen[bytes]
    _folder: tempfile.TemporaryDirectory[str]
    state: JobState = field(default_factory=JobState)
    computed: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    stopped: bool = False
    _complaints: bytearray = field(default_factory=bytearray)
    _readers: list[threading.Thread] = field(default_factory=list)

    @classmethod
    def start(cls, arguments: Sequence[str], *, on_event: Callable[[Event], None]) -> EngineProcess:
        """Start ``python -m engine`` with `arguments`.

        Parameters
        ----------
        arguments : sequence of str
        on_event : callable
            Called in another thread with each event.

        Raises
        ------
        DiskError
            When it cannot be started.
        """
        folder = tempfile.TemporaryDirectory(prefix="gaussian-heritage-")
        try:
            process = subprocess.Popen(
                engine_command(*arguments, "--events", module=_MODULE),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                env={**engine_environment(), STOP_VARIABLE: str(Path(folder.name, _STOP))},
                **own_group(),
            )
        except OSError as error:
            folder.cleanup()
            raise DiskError(f"{sys.executable} could not be started: {error.strerror or error}. Check it.") from error
        run = cls(process, folder)
        assert process.stdout is not None and process.stderr is not None
        run._readers = [
            threading.Thread(target=run._read_events, args=(process.stdout, on_event), daemon=True),
            threading.Thread(target=run._read_errors, args=(process.stderr,), daemon=True),
        ]
        for reader in run._readers:
            reader.start()
        return run

    def stop(self) -> None:
        """Ask the engine to stop at its next safe point."""
        self.stopped = True
        # The folder is gone when the engine has ended.
        with contextlib.suppress(OSError):
            request_stop(Path(self._folder.name, _STOP))

    def wait(self) -> int:
        """Wait for the end and return the exit code; negative: killed by the signal of this number."""
        try:
            code = self.process.wait()
            for reader in self._readers:
                reader.join()
        finally:
            if self.process.poll() is None:
                kill_group(self.process)
            self._folder.cleanup()
            assert self.process.stdin is not None
            self.process.stdin.close()
        return code

    def last_complaint(self) -> str:
        """Return the last line of its standard error, empty if there is none."""
        lines = self._complaints.decode("utf-8", "replace").strip().splitlines()
        return lines[-1].strip()[:500] if lines else ""

    @property
    def cpu_seconds(self) -> float | None:
        """CPU seconds of the process and its children; None when it was killed."""
        return self.state.metrics.get(_CPU_SECONDS)

    def _read_events(self, stream: IO[bytes], on_event: Callable[[Event], None]) -> None:
        with stream:
            for event in events_in(stream):
                self.state.update(event)
                if isinstance(event, StageFinished):
                    (self.kept if event.reused else self.computed).append(event.stage)
                on_event(event)

    def _read_errors(self, stream: IO[bytes]) -> None:
        with stream:
            while chunk := os.read(stream.fileno(), _KEPT_ERRORS):
                self._complaints += chunk
                del self._complaints[:-_KEPT_ERRORS]


def _use_cores(numbers: str) -> None:
    """Keep this process and the threads that it starts on these cores, where the system can do that."""
    if numbers:
        with contextlib.suppress(ValueError, OSError):  # cores that this machine does not have
            use_cores(int(number) for number in numbers.split(","))


def _main() -> int:
    """Run the engine in this process, the child, and report its cost at the end."""
    # Before NumPy and torch count the cores.
    _use_cores(os.environ.get(CORES_VARIABLE, ""))
    no_core_dumps()
    end_children_with_this_process()
    end_with_parent(sys.stdin.buffer)
    code, begin = 0, time.perf_counter()
    try:
        # Exactly what `python -m engine` runs, its end included.
        runpy.run_module(str(__package__).rsplit(".", 2)[0], run_name="__main__")
    except SystemExit as end:
        code = int(end.code or 0)
    taken = Metric("batch", _CPU_SECONDS, cpu_seconds(), seconds=time.perf_counter() - begin)
    print(json_printable(to_json_line(taken), sys.stdout), flush=True)
    return code


if __name__ == "__main__":
    _code = _main()
    sys.stdout.flush()
    # Not `sys.exit`: the thread that waits for the parent holds standard input.
    os._exit(_code)
