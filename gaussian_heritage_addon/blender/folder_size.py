"""The size of a folder, counted while Blender works: a panel cannot wait for thousands of files. Without bpy."""

from __future__ import annotations

import threading
from pathlib import Path

from ...engine.core.files import bytes_of, stamp_of

_known: dict[tuple[Path, tuple[int, int]], int | None] = {}
"""Bytes by folder and the time of its last change; None while they are counted."""


def folder_bytes(folder: Path) -> int | None:
    """Return the bytes of the files in a folder; None while they are being counted, and where there is no folder."""
    changed = stamp_of(folder)
    if changed is None:
        return None
    key = (folder, changed)
    if key not in _known:
        _known.clear()
        _known[key] = None
        threading.Thread(target=_count, args=key, daemon=True).start()
    return _known.get(key)


def _count(folder: Path, changed: tuple[int, int]) -> None:
    _known[folder, changed] = bytes_of(folder)
