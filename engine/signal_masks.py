"""Signals that stop a command, held back while a library must not see them. Standard library only."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator

__all__ = ["signals_held_back"]

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")


@contextlib.contextmanager
def signals_held_back() -> Iterator[None]:
    """Block the signals that stop a command in this thread; those that arrive meanwhile are delivered at the end.

    Threads that are started in the block never take these signals: they inherit the mask and keep it. Without other
    threads no handler can be called in the block. Windows has no such masks, and there nothing is blocked.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {getattr(signal, name) for name in _NAMES})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
