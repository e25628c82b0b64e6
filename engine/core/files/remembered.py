"""Values read from files, kept until the files change: panels ask at each redraw, the server for each event."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from ..errors import HeritageError

_Value = TypeVar("_Value")
_Stamps = tuple[tuple[int, int] | None, ...]
_MAX_FOLDERS = 1000
"""Folders whose value each function keeps, the last one of each: a server's pages ask about all projects at once."""


def stamp_of(file: Path) -> tuple[int, int] | None:
    """Return modification time, in ns, and size of a file, in bytes; None where there is none."""
    try:
        found = file.stat()
    except (OSError, ValueError):  # ValueError: a null character in the path
        return None
    return found.st_mtime_ns, found.st_size


def read_after_change(*names: str) -> Callable[[Callable[[Path], _Value]], Callable[[Path], _Value]]:
    """Return a decorator of functions that read a folder: they read it again only after one of its files changed.

    Parameters
    ----------
    *names : str
        Paths in the folder of the files that the function reads, with ``/``. An error of ours is kept too.
    """

    def decorated(read: Callable[[Path], _Value]) -> Callable[[Path], _Value]:
        kept: dict[Path, tuple[_Stamps, tuple[_Value] | HeritageError]] = {}

        @functools.wraps(read)
        def current(folder: Path) -> _Value:
            stamps = tuple(stamp_of(folder / name) for name in names)
            # Taken out and put back at the end: the first one is that which was asked for longest ago. Two threads that
            # ask at once at worst both read.
            before, found = kept.pop(folder, (None, None))
            if found is None or before != stamps:
                try:
                    found = (read(folder),)
                except HeritageError as error:
                    found = error
            kept[folder] = stamps, found
            while len(kept) > _MAX_FOLDERS:
                kept.pop(next(iter(list(kept))), None)
            if isinstance(found, HeritageError):
                raise found.with_traceback(None)
            return found[0]

        return current

    return decorated
