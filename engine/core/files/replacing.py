"""Files that belong together are replaced together: after a kill at any moment all of them are old, or all are new."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator
from pathlib import Path

from ..errors import DiskError
from ..system import delete_file, replace_file
from .deleting import delete_derived
from .writing import TEMPORARY_PREFIX, write_problem

_NEW = TEMPORARY_PREFIX + "set"
_COMPLETE = ".complete-set"
"""Folder with a complete set of new files. When it exists, they replace the old ones, if need be in a later run."""


@contextlib.contextmanager
def replace_together(folder: Path, *, optional: Collection[str] = ()) -> Iterator[Path]:
    """Yield an empty folder; the files that the block writes there replace those of `folder` when it ends.

    Old and new files are never mixed in `folder`: the old ones are deleted first, a ``.json`` file before the others,
    and the new ones moved in, a ``.json`` file last. An error in the block leaves `folder` as it was.

    Parameters
    ----------
    folder : Path
        Created when missing. Its other files stay.
    optional : collection of str
        Files that are deleted from `folder` when the block does not write them.

    Raises
    ------
    DiskError
        When the disk is full or read-only, or another program uses a file.
    """
    new = folder / _NEW
    try:
        _publish(folder)
        delete_derived(folder, _NEW)
        new.mkdir(parents=True)
        yield new
        for name in optional:
            if not (new / name).exists():
                (new / name).touch()
        replace_file(new, folder / _COMPLETE)
    except OSError as error:
        raise write_problem(folder, error) from error
    finally:
        if new.is_dir():
            delete_derived(folder, _NEW)
    _publish(folder)


def finish_replacements(project: Path) -> None:
    """Finish what a killed run began to replace, in all folders of a project.

    Raises
    ------
    DiskError
        When a file cannot be moved.
    """
    for complete in list(project.rglob(_COMPLETE)):
        _publish(complete.parent)


def _publish(folder: Path) -> None:
    complete = folder / _COMPLETE
    if not complete.is_dir() or complete.is_symlink():
        return
    try:
        names = sorted(path.name for path in complete.iterdir() if path.is_file() and not path.is_symlink())
        names.sort(key=lambda name: name.endswith(".json"))
        for name in reversed(names):
            delete_file(folder / name)
        for name in names:
            # An empty file stands for one that is only deleted.
            if (complete / name).stat().st_size:
                replace_file(complete / name, folder / name)
    except OSError as error:
        raise DiskError(
            f"Could not replace the files of {folder}: {error.strerror or error}. Close programs that use them, then "
            "run again."
        ) from error
    delete_derived(folder, _COMPLETE)
