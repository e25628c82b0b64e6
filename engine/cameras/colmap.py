"""pycolmap without its signal handlers.

Importing pycolmap installs glog's handlers, one of them for SIGTERM: it would print a stack trace and end the process
where the engine saves its work and stops. Modules of this package import pycolmap from here.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
from collections.abc import Iterator

__all__ = ["pycolmap"]

_SIZE = 512
"""Bytes; larger than ``struct sigaction`` on every system."""


@contextlib.contextmanager
def _handlers_kept(*names: str) -> Iterator[None]:
    """Put the handlers of signals back at the end.

    In C, because Python changes handlers in its main thread only, and other threads may import pycolmap too.
    """
    if os.name != "posix":
        yield
        return
    library = ctypes.CDLL(None)
    handlers = {int(getattr(signal, name)): ctypes.create_string_buffer(_SIZE) for name in names}
    for number, handler in handlers.items():
        library.sigaction(number, None, handler)
    try:
        yield
    finally:
        for number, handler in handlers.items():
            library.sigaction(number, handler, None)


with _handlers_kept("SIGINT", "SIGTERM", "SIGHUP"):
    import pycolmap
