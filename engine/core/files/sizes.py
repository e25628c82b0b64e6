"""The bytes of files and folders, also while other processes write and delete there."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


def bytes_of(path: Path) -> int:
    """Return the size of a file, or of all files in a folder; what is not there or cannot be read counts nothing."""
    if path.is_symlink() or not path.is_dir():
        files = [str(path)]
    else:
        files = [os.path.join(folder, name) for folder, _, names in os.walk(path) for name in names]
    total = 0
    for file in files:
        with contextlib.suppress(OSError):
            total += os.lstat(file).st_size
    return total
