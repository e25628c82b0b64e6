"""Stored names become paths here, and no path leaves its folder."""

from __future__ import annotations

import os
from pathlib import Path, PurePath

from ..errors import FormatError, ProjectError

__all__ = ["is_inner_name", "object_file", "path_within", "require_no_links_out"]

_MAX_NAME_BYTES = 255


def is_inner_name(name: object) -> bool:
    """Return whether `name` is a relative path that stays inside of the folder that it is joined to.

    Absolute paths, drive letters, ``..``, empty names, null characters and names that no file system takes are not.
    """
    if not isinstance(name, str) or "\0" in name:
        return False
    path = PurePath(name)
    too_long = any(len(part.encode("utf-8", "surrogatepass")) > _MAX_NAME_BYTES for part in path.parts)
    return path != PurePath() and not path.anchor and ".." not in path.parts and not too_long


def path_within(folder: Path, *names: str) -> Path:
    """Return the path of stored names below `folder`.

    A name from a project, a .blend file or another stored file becomes a path here only, so that no file outside of
    `folder` can be read, written or deleted through it. `folder` itself may be a link; links inside must not lead out.

    Raises
    ------
    FormatError
        When the path would leave `folder`.
    """
    if not all(map(is_inner_name, names)) or not _resolves_into(path := folder.joinpath(*names), folder):
        raise FormatError(
            f"{'/'.join(map(str, names))!r} leads out of the folder {folder}, so it is not used. Another program has "
            "changed the project; use it only if you know who made it."
        )
    return path


def object_file(project: Path, object_id: str, name: str) -> Path:
    """Return the path of a file of an object, ``objects/<id>/<name>``; raises `FormatError` as `path_within` does."""
    return path_within(project, "objects", object_id, name)


def _resolves_into(path: Path, folder: Path) -> bool:
    """Return whether `path`, with all links followed, lies in `folder`."""
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # a loop of links, or a name that is too long
        return False


def require_no_links_out(project: Path) -> None:
    """Raise `ProjectError` when a link in the folder leads out of it: a job would write or delete there."""
    for folder, folders, files in os.walk(project):
        for name in (*folders, *files):
            path = Path(folder, name)
            if path.is_symlink() and not _resolves_into(path, project):
                raise ProjectError(f"{path} is a link that leads out of the project. Delete the link, then run again.")
