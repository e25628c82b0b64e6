"""The trash: what a user removed can be brought back until it is emptied, by the user or after some days."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import DiskError
from ..core.files import bytes_of, delete_derived, is_inner_name
from ..core.system import name_in_order, replace_file

_DAY = 86400
_sizes: dict[Path, int] = {}
"""Bytes of each item that was measured: nothing changes in the trash."""


@dataclass(frozen=True)
class TrashItem:
    """A file or folder in the trash.

    Attributes
    ----------
    id : str
        Name of the folder that holds it.
    path : Path
    """

    id: str
    path: Path

    @property
    def name(self) -> str:
        """Its name before it was removed."""
        return self.path.name

    @property
    def n_bytes(self) -> int:
        """Its size on the disk."""
        if self.path not in _sizes:
            _sizes[self.path] = bytes_of(self.path)
        return _sizes[self.path]


class Trash:
    """The trash in `folder`, which is made when it is needed."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def items(self) -> list[TrashItem]:
        """Return what is in it, the newest first."""
        if not self._folder.is_dir():
            return []
        found = []
        for holder in sorted((Path(entry) for entry in os.scandir(self._folder)), reverse=True):
            content = os.listdir(holder) if holder.is_dir() and not holder.is_symlink() else []
            found += [TrashItem(holder.name, holder / name) for name in content[:1]]
        return found

    def find(self, item_id: str) -> TrashItem | None:
        """Return the item of this id; None where there is none."""
        return next((item for item in self.items() if item.id == item_id), None)

    def take(self, path: Path) -> TrashItem:
        """Move a file or folder here.

        Raises
        ------
        DiskError
            When it cannot be moved.
        """
        holder = self._folder / name_in_order(())
        try:
            holder.mkdir(parents=True)
            replace_file(path, holder / path.name)
        except OSError as error:
            raise DiskError(f"{path.name} could not be removed: {error.strerror or error}.") from error
        return TrashItem(holder.name, holder / path.name)

    def give_back(self, item: TrashItem, target: Path) -> None:
        """Move an item to `target`, which does not exist.

        Raises
        ------
        DiskError
            When it cannot be moved.
        """
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            replace_file(item.path, target)
        except OSError as error:
            raise DiskError(f"{item.name} could not be brought back: {error.strerror or error}.") from error
        self._delete(item.id)

    def empty(self, older_than_days: float = 0.0) -> None:
        """Delete what was removed before this many days.

        Raises
        ------
        DiskError
            When something cannot be deleted.
        """
        oldest = time.time() - older_than_days * _DAY
        if not self._folder.is_dir():
            return
        for entry in list(os.scandir(self._folder)):
            # The holder is made when the item is removed.
            if is_inner_name(entry.name) and (
                not older_than_days or entry.stat(follow_symlinks=False).st_mtime < oldest
            ):
                self._delete(entry.name)

    def used_bytes(self) -> int:
        """Return the size of everything in it."""
        return sum(item.n_bytes for item in self.items())

    def _delete(self, item_id: str) -> None:
        delete_derived(self._folder, item_id)
        for path in [path for path in _sizes if path.parent == self._folder / item_id]:
            _sizes.pop(path, None)
