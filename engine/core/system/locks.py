"""Locks of files, which end with the program that holds them, even by kill -9."""

from __future__ import annotations

import errno
import sys
from typing import IO

_HELD = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES)
"""Errors of a lock that another program holds; others mean that the disk has no locks."""


def try_lock(stream: IO[str]) -> bool:
    """Lock an open file until it is closed, and return whether this worked; False when another program holds it.

    Raises
    ------
    OSError
        When the disk has no locks.
    """
    try:
        _lock(stream)
    except OSError as error:
        if error.errno in _HELD:
            return False
        raise
    return True


def _lock(stream: IO[str]) -> None:
    if sys.platform == "win32":
        import msvcrt

        stream.seek(0)
        msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
