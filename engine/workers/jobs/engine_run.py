"""The engine as a child process of a worker or a server: followed by its events, stopped on request, never left behind.

A child that needs too much memory is killed alone. It ends when the process that started it dies, so that a worker that
repeats the stage finds the project unlocked.
"""

from __future__ import annotations

import contextlib
import os
import runpy
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO

from ...core.engine_process import EngineProcess, engine_command, engine_environment, events_in
from ...core.errors import DiskError
from ...core.events import Event, Metric, StageFinished, to_json_line
from ...core.system import (
    cpu_seconds,
    end_children_with_this_process,
    end_with_parent,
    json_printable,
    no_core_dumps,
    use_given_cores,
)
from .job import JobState

_CPU_SECONDS = "process_cpu_seconds"


class EngineRun:
    """``python -m engine`` with arguments, running now or ended.

    Parameters
    ----------
    on_event : callable
        Called in another thread with each event.
    module : str
        What the process runs: a module that calls `run_as_child`.
    variables : mapping
        Environment variables that it gets besides those of this process.

    Attributes
    ----------
    process : EngineProcess
    state : JobState
        What its events say so far.
    computed, kept : list of str
        Stages that it computed, and those that were done already.
    stopped : bool
        Whether `stop` was called.
    late : bool
        Whether it was killed because it took too long.

    Raises
    ------
    DiskError
        When it cannot be started.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        on_event: Callable[[Event], None],
        *,
        module: str = __name__,
        variables: Mapping[str, str] | None = None,
    ) -> None:
        self.state = JobState()
        self.stopped = self.late = False
        self.computed: list[str] = []
        self.kept: list[str] = []
        self._on_event = on_event
        self._folder = tempfile.TemporaryDirectory(prefix="gaussian-heritage-")
        command = engine_command(*arguments, "--events", module=module)
        try:
            self.process = EngineProcess.start(
                command, {**engine_environment(), **(variables or {})}, self._follow, folder=Path(self._folder.name)
            )
        except DiskError:
            self._folder.cleanup()
            raise

    def stop(self) -> None:
        """Ask the engine to stop at its next safe point."""
        self.stopped = True
        # The folder is gone when the engine has ended.
        with contextlib.suppress(DiskError):
            self.process.stop()

    def wait(self, seconds: float | None = None) -> int:
        """Wait for the end, kill it after `seconds`, and return the exit code; negative: killed by this signal."""
        with self._folder, self.process:
            self.late = not self.process.wait(seconds)
        assert self.process.code is not None
        return self.process.code

    @property
    def cpu_seconds(self) -> float | None:
        """CPU seconds of the process and its children; None when it was killed."""
        return self.state.metrics.get(_CPU_SECONDS)

    def _follow(self, stream: IO[bytes]) -> None:
        for event in events_in(stream):
            self.state.update(event)
            if isinstance(event, StageFinished):
                (self.kept if event.reused else self.computed).append(event.stage)
            self._on_event(event)


def run_as_child() -> int:
    """Run the engine in this process, the child, report its cost at the end, and return its exit code."""
    # Before NumPy and torch count the cores.
    use_given_cores()
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
    _code = run_as_child()
    sys.stdout.flush()
    # Not `sys.exit`: the thread that waits for the parent holds standard input.
    os._exit(_code)
