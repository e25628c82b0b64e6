"""Whether a process runs a given command: before it is waited for, and above all before it gets a signal. No bpy."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from ..errors import FormatError
from ..files import read_bytes

__all__ = ["process_runs"]

_PROC = Path("/proc")
_MAX_COMMAND_BYTES = 1 << 22
"""More than the systems allow."""
_MAX_LIST_SECONDS = 10.0


def process_runs(pid: int, command: Sequence[str], folder: Path) -> bool | None:
    """Return whether process `pid` is ours and runs `command` in `folder`; None when the system does not tell.

    The system may have given the number to another program since, and the file with the number may be another
    computer's.

    Parameters
    ----------
    pid : int
    command : sequence of str
    folder : Path
        Working directory of the process, compared where the system tells it (Linux).
    """
    if sys.platform == "win32":
        return _listed(["tasklist", "/FI", f"PID eq {pid}", "/NH"], Path(command[0]).name)
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, PermissionError, OverflowError):  # not there, another user's, or no number of a process
        return False
    if (_PROC / str(os.getpid()) / "cmdline").exists():
        return _runs_in_proc(_PROC / str(pid), command, folder)
    return _listed(["ps", "-ww", "-o", "stat=,args=", "-p", str(pid)], " ".join(command[1:]) or command[0])


def _runs_in_proc(process: Path, command: Sequence[str], folder: Path) -> bool:
    try:
        words = read_bytes(process / "cmdline", max_bytes=_MAX_COMMAND_BYTES, advice="").split(b"\0")[:-1]
        directory = (process / "cwd").resolve(strict=True)
        expected = [os.fsencode(word) for word in command]
        # A script is started by its interpreter, and an interpreter may be named by another path.
        same = words[-len(expected) :] == expected or (len(expected) > 1 and words[1:] == expected[1:])
        return same and directory == folder.resolve()
    except (FormatError, OSError, ValueError):  # it ended meanwhile, or is a zombie
        return False


def _listed(listing: list[str], expected: str) -> bool | None:
    try:
        done = subprocess.run(
            listing, capture_output=True, text=True, errors="replace", check=False, timeout=_MAX_LIST_SECONDS
        )
    # Small containers have no `ps`.
    except (OSError, subprocess.TimeoutExpired):
        return None
    return expected in done.stdout and not done.stdout.lstrip().startswith("Z")
