"""Size and SHA-256 of files: recorded when a file is written, compared before it is used."""

from __future__ import annotations

import os
import stat
import time
from pathlib import Path

from ..errors import FormatError
from ..system import change_time_ns
from .schema import Schema
from .writing import file_sha256

FileRecord = dict[str, int | str]
"""``size`` in bytes and ``sha256``."""

FILE_RECORD: Schema = {"size": int, "sha256": str}

_SETTLED_SECONDS = 2.0
"""A file that changed more recently is hashed at each call, because times of files are coarse and may hide a change."""

_MAX_REMEMBERED = 4096

_hashes: dict[tuple[str, int, int, int, int], str] = {}
"""Hashes by path, inode, size and times, so that one command does not hash the same file several times."""


def record_of(path: Path) -> FileRecord:
    """Return the size and the SHA-256 of a file.

    Raises
    ------
    FormatError
        When it cannot be read.
    """
    try:
        found = path.stat()
        return {"size": found.st_size, "sha256": _sha256(path, found)}
    except OSError as error:
        raise FormatError(f"{path} cannot be read: {error.strerror or error}. Run the same command again.") from error


def is_as_recorded(path: Path, record: FileRecord) -> bool:
    """Return whether `path` is a file with the size and the SHA-256 of `record`."""
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode) or found.st_size != record["size"]:
            return False
        return _sha256(path, found) == record["sha256"]
    except (OSError, ValueError):
        return False


def _sha256(path: Path, found: os.stat_result) -> str:
    changed = change_time_ns(path, found)
    identity = (str(path), found.st_ino, found.st_size, found.st_mtime_ns, changed)
    known = _hashes.get(identity)
    if known is not None:
        return known
    digest = file_sha256(path)
    if time.time() - max(found.st_mtime_ns, changed) / 1e9 > _SETTLED_SECONDS:
        if len(_hashes) >= _MAX_REMEMBERED:
            _hashes.clear()
        _hashes[identity] = digest
    return digest
