"""Signals that stop a command, held back while a library must not see them or would take them for itself."""

from __future__ import annotations

import contextlib
import ctypes
import signal
import sys
from collections.abc import Iterator

_SIGACTION_BYTES = 512
"""Larger than ``struct sigaction`` on every system."""


@contextlib.contextmanager
def signals_held_back() -> Iterator[None]:
    """Block the signals that stop a command in this thread; those that arrive meanwhile are delivered at the end.

    Threads that are started in the block never take these signals: they inherit the mask and keep it. Without other
    threads no handler can be called in the block. Windows has no such masks, and there nothing is blocked.
    """
    if sys.platform == "win32":
        yield
        return
    stopping = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, stopping)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def handlers_kept() -> Iterator[None]:
    """Put the handlers of the signals that stop a command back at the end, after a library has set its own.

    In C, because Python changes handlers in its main thread only, and other threads may import libraries too. Windows
    has no such signals.
    """
    if sys.platform == "win32":
        yield
        return
    library = ctypes.CDLL(None)
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    handlers = {int(number): ctypes.create_string_buffer(_SIGACTION_BYTES) for number in numbers}
    for number, handler in handlers.items():
        library.sigaction(number, None, handler)
    try:
        yield
    finally:
        for number, handler in handlers.items():
            library.sigaction(number, handler, None)
