"""Folders without photos of the user: hidden ones, and those in which systems keep thumbnails and deleted files."""

from __future__ import annotations

import os
import stat
from pathlib import Path

_SYSTEM_FOLDERS = frozenset({
    "__macosx", "@eadir", "@tmp", "@__thumb", "@recycle", "#recycle", "#snapshot", "@recently-snapshot", "@sharebin",
    "@synoresource", "$recycle.bin", "recycler", "system volume information", "lost+found", "found.000",
    "network trash folder", "temporary items",
})  # fmt: skip
"""Names in small letters: macOS archives, Synology, QNAP, Windows, Linux, network drives."""


def is_skipped_folder(path: Path) -> bool:
    """Return whether a sub-folder of the photos is hidden or kept by a system for itself.

    Hidden is a name that begins with a dot, and on Windows and macOS a folder with the attribute.
    """
    if path.name.startswith(".") or path.name.lower() in _SYSTEM_FOLDERS:
        return True
    try:
        status = os.lstat(path)
    except OSError:
        return False
    windows, mac = getattr(status, "st_file_attributes", 0), getattr(status, "st_flags", 0)
    return bool(windows & stat.FILE_ATTRIBUTE_HIDDEN or mac & stat.UF_HIDDEN)
