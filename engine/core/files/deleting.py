"""Deleting data that can be computed again. What a user made goes to the trash instead, `engine.project.objects`."""

from __future__ import annotations

from pathlib import Path

from ..errors import DiskError
from ..system import delete_file, delete_tree
from .paths import path_within


def delete_derived(folder: Path, *names: str) -> None:
    """Delete the file or folder `names` below `folder`, if it exists; a link is deleted, never what it leads to.

    Parameters
    ----------
    folder : Path
        A folder that we made.
    names : str
        As for `path_within`.

    Raises
    ------
    FormatError
        When the path would leave `folder`.
    DiskError
        When it cannot be deleted.
    """
    path = path_within(folder, *names)
    try:
        if path.is_dir() and not path.is_symlink():
            delete_tree(path)
        else:
            delete_file(path)
    except FileNotFoundError:
        pass  # another process deleted it meanwhile
    except OSError as error:
        which, why = error.filename or path, error.strerror or error
        raise DiskError(f"Could not delete {which}: {why}. Close programs that use it, then run again.") from error
