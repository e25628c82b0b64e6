"""The size of a folder, counted beside Blender's work: a panel cannot wait for thousands of files. Without bpy."""

from __future__ import annotations

import os
import threading
from pathlib import Path

__all__ = ["count", "folder_bytes"]

_known: dict[tuple[Path, int], int | None] = {}
"""Bytes by folder and the time of its last change; None while they are counted."""


def folder_bytes(folder: Path) -> int | None:
    """Return the bytes of the files in a folder; None while they are being counted, and where there is no folder."""
    try:
        key = (folder, folder.stat().st_mtime_ns)
    except OSError:
        return None
    if key not in _known:
        _known.clear()
        _known[key] = None
        threading.Thread(target=_count, args=key, daemon=True).start()
    return _known.get(key)


def count(folder: Path) -> int:
    """Count the bytes of the files in a folder; those that cannot be read count nothing."""
    total = 0
    for where, _, names in os.walk(folder):
        for name in names:
            try:
                total += os.lstat(os.path.join(where, name)).st_size
            except OSError:
                continue
    return total


def _count(folder: Path, changed: int) -> None:
    _known[folder, changed] = count(folder)
