"""Ctrl-C, Ctrl-Break, SIGTERM and SIGHUP as a request to stop at the next safe point."""

from __future__ import annotations

import contextlib
import os
import signal

__all__ = ["StopOnSignal"]


class StopOnSignal:
    """A `StopCheck` that becomes true on the first Ctrl-C, Ctrl-Break, SIGTERM or SIGHUP.

    The second one stops at once, and the third one ends the process even inside of a library that never returns.
    """

    # Blender's Cancel sends Ctrl-Break on Windows, where SIGBREAK exists. SIGHUP means that the terminal was closed.
    _NAMES = ("SIGINT", "SIGTERM", "SIGBREAK", "SIGHUP")

    def __init__(self) -> None:
        self._requested = False

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
