"""Photos and projects as values that travel with a task, for workers that do not share the folders.

No archives: a file is a name, its time of change and its bytes. Names are checked before anything is written.
"""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath
from typing import TypedDict

from ...core.errors import FormatError, ProjectError
from ...core.files import TEMPORARY_PREFIX, delete_derived, path_within, read_bytes, write_file, write_problem
from ...photos import picture_files
from ...project.folder import PROJECT_FILE

Files = dict[str, tuple[int, bytes]]
"""Name relative to the folder, with slashes: time of change in nanoseconds, and content."""

_STAY = ("lock", "checkpoints", "first_picture", "log.jsonl")
"""Files of a project that are not sent."""
_ADVICE = "Run the batch again."


class Bundle(TypedDict):
    """Files that are sent with a task."""

    photos: Files
    project: Files


def _names(project: Path) -> list[str]:
    found = []
    for folder, folders, files in os.walk(project):
        inner = Path(folder).relative_to(project)
        if inner == Path("."):
            folders[:] = [name for name in folders if name not in _STAY]
        # Working copies of photos in which features were detected: used by the stage that made them alone.
        folders[:] = [name for name in folders if not name.startswith("sfm-")]
        for name in files:
            path = inner / name
            if name.startswith(TEMPORARY_PREFIX) or path.as_posix() in _STAY or (project / path).is_symlink():
                continue
            found.append(path.as_posix())
    return sorted(found)


def pack(project: Path, max_bytes: int | None) -> Files:
    """Return the files of a project, without checkpoints, working copies and log.

    Parameters
    ----------
    max_bytes : int or None
        Most that is read; None: no limit.

    Raises
    ------
    ProjectError
        When there is more.
    FormatError
        When a file cannot be read.
    """
    return _pack(project, [project / name for name in _names(project)], max_bytes)


def pack_photos(folder: Path, max_bytes: int | None) -> Files:
    """Return the photos of a folder with their times of change; raises as `pack` does."""
    return _pack(folder, picture_files(folder, without=None), max_bytes)


def _pack(folder: Path, paths: list[Path], max_bytes: int | None) -> Files:
    files: Files = {}
    total = 0
    for path in paths:
        try:
            status = path.stat()
        except OSError as error:
            raise FormatError(f"{path} cannot be read: {error.strerror or error}. {_ADVICE}") from error
        total += status.st_size
        if max_bytes is not None and total > max_bytes:
            raise ProjectError(
                f"{folder} has more than {max_bytes / 1e9:.1f} GB to send. Use workers that share the folders, "
                "without --ship."
            )
        content = read_bytes(path, max_bytes=status.st_size, advice=_ADVICE)
        files[path.relative_to(folder).as_posix()] = (status.st_mtime_ns, content)
    return files


def unpack(files: Files, folder: Path) -> None:
    """Write files into a folder, ``project.json`` last: it counts files as done that are there already.

    Raises
    ------
    FormatError
        When a name leads out of the folder.
    DiskError
        When a file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in sorted(files, key=lambda name: (name == PROJECT_FILE, name)):
            changed, content = files[name]
            path = path_within(folder, *PurePosixPath(name).parts)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_file(path, content)
            os.utime(path, ns=(changed, changed))
    except OSError as error:
        raise write_problem(folder, error) from error


def mirror(files: Files, project: Path) -> None:
    """Make a project what a worker made of it. What it deleted or moved is deleted after everything else is written.

    Raises
    ------
    FormatError, DiskError
        As `unpack` does.
    """
    before = _names(project)
    unpack(files, project)
    for name in before:
        if name not in files:
            delete_derived(project, *PurePosixPath(name).parts)
