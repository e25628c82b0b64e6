"""Text of other programs, whatever the code page of the system: Windows has one for each region of the world."""

from __future__ import annotations

import json
import os
import re
import subprocess
from collections.abc import Mapping, Sequence
from typing import TextIO

from .processes import no_window

_NOT_ASCII = re.compile(r"[^\x00-\x7f]")


def printable(text: str, stream: TextIO) -> str:
    """Return `text` with the characters that `stream` cannot encode as escape sequences."""
    encoding = stream.encoding or "utf-8"
    return text.encode(encoding, "backslashreplace").decode(encoding)


def json_printable(line: str, stream: TextIO) -> str:
    """Return a line of JSON in ASCII, if `stream` has another encoding than UTF-8."""
    if (stream.encoding or "utf-8").lower().replace("-", "") == "utf8":
        return line
    return _NOT_ASCII.sub(lambda found: json.dumps(found[0])[1:-1], line)


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
        Environment variables; by default, those of this process. Python writes UTF-8.
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
