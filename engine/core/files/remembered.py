"""What was read of files, kept until they change: panels ask at each redraw, the server for each event."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from ..errors import HeritageError

__all__ = ["read_after_change", "stamp_of"]

_Value = TypeVar("_Value")
_MAX_FOLDERS = 4
"""Folders whose values each function keeps: those of the scenes in one .blend file."""


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
        @functools.lru_cache(maxsize=_MAX_FOLDERS)
        def kept(folder: Path, _: tuple[tuple[int, int] | None, ...]) -> tuple[_Value] | HeritageError:
            try:
                return (read(folder),)
            except HeritageError as error:
                return error

        @functools.wraps(read)
        def current(folder: Path) -> _Value:
            found = kept(folder, tuple(stamp_of(folder / name) for name in names))
            if isinstance(found, HeritageError):
                raise found.with_traceback(None)
            return found[0]

        return current

    return decorated
