"""Text of other programs, whatever the code page of the system: Windows has one for each region of the world."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence

from .processes import no_window

__all__ = ["run_text", "with_utf8"]


def with_utf8(environment: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return environment variables with which Python writes UTF-8: by default, those of this process."""
    return {**(os.environ if environment is None else environment), "PYTHONUTF8": "1", "PYTHONIOENCODING": "utf-8"}


def run_text(
    command: Sequence[object],
    *,
    timeout: float | None = None,
    environment: Mapping[str, str] | None = None,
    folder: os.PathLike[str] | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run a program that asks nothing, and return its output as text.

    Parameters
    ----------
    command : sequence
        Program and arguments.
    timeout : float, optional
        Seconds.
    environment : mapping, optional
        Environment variables; by default, those of this process. Python is told to write UTF-8.
    folder : path, optional
        Working directory.

    Raises
    ------
    OSError, subprocess.TimeoutExpired
        When it cannot be started, or does not end in time.
    """
    return subprocess.run(
        [str(part) for part in command], stdin=subprocess.DEVNULL, capture_output=True, check=False, timeout=timeout,
        env=with_utf8(environment), cwd=folder, encoding="utf-8", errors="replace", **no_window(),
    )  # fmt: skip
