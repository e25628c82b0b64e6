"""Stored names become paths here, and no path leaves its folder."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path, PurePath

from ..errors import FormatError, ProjectError

_MAX_NAME_BYTES = 255
_MAX_SHOWN = 200
"""Characters of a name that a message shows."""
_KEPT_BYTES, _HASH_DIGITS = 180, 16
"""Characters that a derived name keeps of a name that is too long, and of its hash."""
_LEADS_OUT = "leads out of its folder"
_CHANGED = "Another program has changed the project; use it only if you know who made it."


def is_inner_name(name: object) -> bool:
    """Return whether `name` is a relative path that stays inside of the folder that it is joined to.

    Absolute paths, drive letters, ``..``, empty names, null characters and names that no file system takes are not;
    `problem_of_inner_name` says which of these.
    """
    return problem_of_inner_name(name) is None


def problem_of_inner_name(name: object) -> str | None:
    """Return why `name` is not usable below a folder (see `is_inner_name`), as a clause; None for a usable name."""
    if not isinstance(name, str):
        return "is not text"
    path = PurePath(name)
    if path.anchor or ".." in path.parts:
        return _LEADS_OUT
    if path == PurePath():
        return "is empty"
    if "\0" in name:
        return "has a null character"
    longest = max(len(part.encode("utf-8", "surrogatepass")) for part in path.parts)
    if longest > _MAX_NAME_BYTES:
        return f"is too long: a part of it has {longest} bytes, and file systems take at most {_MAX_NAME_BYTES}"
    return None


def path_within(folder: Path, *names: str) -> Path:
    """Return the path of stored names below `folder`.

    A name from a project, a .blend file or another stored file becomes a path here only, so that no file outside of
    `folder` can be read, written or deleted through it. `folder` itself may be a link; links inside must not lead out.

    Raises
    ------
    FormatError
        When the path would leave `folder`, or no file can have this name; the message says which.
    """
    problem = next((found for name in names if (found := problem_of_inner_name(name)) is not None), None)
    path = folder if problem else folder.joinpath(*names)
    problem = problem or _problem_of_place(path, folder)
    if problem is None:
        return path
    shown = "/".join(map(str, names))
    shown = repr(shown if len(shown) <= _MAX_SHOWN else f"{shown[:_MAX_SHOWN]}...")
    if problem == _LEADS_OUT:
        raise FormatError(f"{shown} leads out of the folder {folder}, so it is not used. {_CHANGED}")
    advice = "Give what it is named after a shorter name." if "long" in problem else _CHANGED
    raise FormatError(f"{shown} cannot be a file in {folder}: it {problem}. {advice}")


def derived_name(name: str, suffix: str) -> str:
    """Return the name of a file that belongs to the file `name`: ``name + suffix``, or a short one where no file system
    would take that.

    Parameters
    ----------
    name : str
        Relative path of a photo, say. Its folders are kept.
    suffix : str
        What is added, such as ``.npz``.

    Returns
    -------
    str
        Different for different names: the end of a name that is too long is replaced by a hash of it.
    """
    folder, slash, last = name.rpartition("/")
    if len((last + suffix).encode("utf-8", "surrogatepass")) <= _MAX_NAME_BYTES:
        return name + suffix
    digest = hashlib.sha256(last.encode("utf-8", "surrogatepass")).hexdigest()[:_HASH_DIGITS]
    start = last.encode("utf-8", "surrogatepass")[:_KEPT_BYTES].decode("utf-8", "ignore")
    return f"{folder}{slash}{start}-{digest}{suffix}"


def object_file(project: Path, object_id: str, name: str) -> Path:
    """Return the path of a file of an object, ``objects/<id>/<name>``; raises `FormatError` as `path_within` does."""
    return path_within(project, "objects", object_id, name)


def _problem_of_place(path: Path, folder: Path) -> str | None:
    """Return why `path`, with all links followed, is no place in `folder`, as a clause."""
    try:
        return None if path.resolve().is_relative_to(folder.resolve()) else _LEADS_OUT
    except RuntimeError:
        return "is a link that leads to itself"
    except OSError as error:
        return f"cannot be used by this system ({error.strerror})"


def _resolves_into(path: Path, folder: Path) -> bool:
    return _problem_of_place(path, folder) is None


def require_no_links_out(project: Path) -> None:
    """Raise `ProjectError` when a link in the folder leads out of it: a job would write or delete there."""
    for folder, folders, files in os.walk(project):
        for name in (*folders, *files):
            path = Path(folder, name)
            if path.is_symlink() and not _resolves_into(path, project):
                raise ProjectError(f"{path} is a link that leads out of the project. Delete the link, then run again.")
