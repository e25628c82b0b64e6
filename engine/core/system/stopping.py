"""Requests to stop at the next safe point: from a terminal by a signal, from another program by a file.

Windows has no signal that reaches a process without a console, so Blender, the server and a batch make a file, on all
systems. Its path is in an environment variable of the process that looks for it.
"""

from __future__ import annotations

import contextlib
import os
import signal
import time
from pathlib import Path

STOP_VARIABLE = "GAUSSIAN_HERITAGE_STOP_FILE"
"""Environment variable with the path of the file that asks a process to stop."""

_LOOK_SECONDS = 0.1
"""Time between two looks for the file: a `StopCheck` may be called millions of times."""


def request_stop(file: Path) -> None:
    """Ask the process whose `STOP_VARIABLE` names `file` to stop at its next safe point.

    Raises
    ------
    OSError
        When the file cannot be made.
    """
    # Not through a link, which may lead to a file of another program.
    with contextlib.suppress(FileExistsError), file.open("x"):
        pass


class StopOnSignal:
    """A `StopCheck` that becomes true on Ctrl-C, Ctrl-Break, SIGTERM, SIGHUP or the file of `request_stop`.

    The second signal stops at once, and the third one ends the process even inside of a library that never returns.
    """

    # SIGHUP means that the terminal was closed. SIGBREAK exists on Windows.
    _NAMES = ("SIGINT", "SIGTERM", "SIGBREAK", "SIGHUP")

    def __init__(self) -> None:
        self._requested = False
        # Emptied for the processes that this one starts: it stops them itself.
        self._file = os.environ.pop(STOP_VARIABLE, "")
        self._looked = -_LOOK_SECONDS

    def __enter__(self) -> StopOnSignal:
        numbers = [getattr(signal, name) for name in self._NAMES if hasattr(signal, name)]
        self._before = {
            number: signal.signal(number, self._request) for number in numbers if not _is_left_to_nohup(number)
        }
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __call__(self) -> bool:
        if not self._requested and self._file:
            now = time.monotonic()
            if now - self._looked >= _LOOK_SECONDS:
                self._looked = now
                self._requested = os.path.exists(self._file)
        return self._requested

    def _request(self, number: int, frame: object) -> None:
        if self._requested:
            for other in self._before:
                signal.signal(other, signal.SIG_DFL)
            raise KeyboardInterrupt
        self._requested = True
        _leave_closed_terminal()
        # Not print: the signal may arrive during a print, and Python does not allow nested writes.
        with contextlib.suppress(OSError):
            os.write(2, b"Stopping at the next safe point (once more: at once) ...\n")


def _is_left_to_nohup(number: int) -> bool:
    """Return whether `number` is SIGHUP and ignored: the user started this with nohup, to close the terminal."""
    return number == getattr(signal, "SIGHUP", None) and signal.getsignal(number) == signal.SIG_IGN


def _leave_closed_terminal() -> None:
    """Discard what is printed where nobody can read it any more: otherwise a print fails before the work is saved."""
    for number in (1, 2):
        try:
            os.write(number, b"")
        except OSError:
            with contextlib.suppress(OSError), open(os.devnull, "wb") as nowhere:
                os.dup2(nowhere.fileno(), number)
