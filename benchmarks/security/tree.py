"""A picture of a folder tree: what every file, folder and link in it is, so that any change is found."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Collection
from pathlib import Path

Snapshot = dict[str, tuple[object, ...]]


def snapshot(root: Path, *, without: Collection[Path] = ()) -> Snapshot:
    """Return the kind, mode, times of change, size and SHA-256 of everything below `root`.

    Parameters
    ----------
    root : Path
    without : collection of Path
        Folders whose content is left out. Their own entry and the times of their parents are kept.

    Notes
    -----
    Links are never followed. A folder's time of change says that a file in it was made, renamed or deleted.
    """
    found: Snapshot = {}
    for folder, folders, files in os.walk(root):
        here = Path(folder)
        for name in [*folders, *files]:
            path = here / name
            found[os.fsencode(path.relative_to(root)).decode("utf-8", "replace")] = _entry(path, path in without)
        folders[:] = [name for name in folders if here / name not in without]
    return found


def _entry(path: Path, left_out: bool) -> tuple[object, ...]:
    status = path.lstat()
    if stat.S_ISLNK(status.st_mode):
        return ("link", os.readlink(path), status.st_mtime_ns)
    if left_out:
        return ("left out",)
    if stat.S_ISDIR(status.st_mode):
        return ("folder", stat.S_IMODE(status.st_mode), status.st_mtime_ns)
    digest = hashlib.sha256(path.read_bytes()).hexdigest() if stat.S_ISREG(status.st_mode) else ""
    return ("file", stat.S_IMODE(status.st_mode), status.st_mtime_ns, status.st_size, digest)


def differences(before: Snapshot, after: Snapshot) -> list[str]:
    """Return what was made, deleted or changed, one sentence each."""
    made = [f"{name} was made" for name in after.keys() - before.keys()]
    gone = [f"{name} was deleted or moved" for name in before.keys() - after.keys()]
    changed = [f"{name} was changed" for name in before.keys() & after.keys() if before[name] != after[name]]
    return sorted(made + gone + changed)


def changed_bytes(before: Snapshot, after: Snapshot) -> int:
    """Return the bytes of all files that were made, deleted or changed."""
    names = {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}
    return sum(max(_size(before.get(name)), _size(after.get(name))) for name in names)


def _size(entry: tuple[object, ...] | None) -> int:
    return int(str(entry[3])) if entry is not None and entry[0] == "file" else 0
