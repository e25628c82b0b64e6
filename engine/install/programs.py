"""Programs that an installation runs, such as pip: their output goes to a file, and they are never left behind."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO

from ..core.errors import EnvironmentProblem
from ..core.system import no_window, with_utf8

_POLL_SECONDS = 0.1


def run_program(
    command: Sequence[object],
    output: IO[bytes],
    environment: Mapping[str, str],
    *,
    on_wait: Callable[[], None],
    folder: Path | None = None,
) -> int:
    """Run a program that asks nothing, and return its exit code.

    Parameters
    ----------
    command : sequence
        Program and arguments.
    output : binary file
        Gets the program's output and its errors.
    environment : mapping
        Environment variables; Python writes UTF-8 in addition.
    on_wait : callable
        Called several times a second, and once at the end. What it raises ends the program.
    folder : Path, optional
        Working directory.

    Raises
    ------
    EnvironmentProblem
        When the program cannot be started.
    """
    try:
        process = subprocess.Popen(
            [str(part) for part in command], stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
            env=with_utf8(environment), cwd=folder, **no_window(),
        )  # fmt: skip
    except OSError as error:
        raise EnvironmentProblem(f"{command[0]} could not be started: {error.strerror or error}.") from error
    try:
        while process.poll() is None:
            on_wait()
            time.sleep(_POLL_SECONDS)
        on_wait()
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait()
    return process.returncode
