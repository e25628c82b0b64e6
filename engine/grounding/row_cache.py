"""A cache of a model's output rows on disk: derived data of limited size, computed again when a file is missing."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import DiskError
from ..files import atomic_write

__all__ = ["RowCache"]

_LOG = logging.getLogger(__name__)

Float32 = NDArray[np.float32]


class RowCache:
    """Cache of arrays of shape [n, `width`], float32, one file per array.

    Parameters
    ----------
    folder : Path
        Created when needed.
    width : int
        Number of columns.
    max_files : int
        Largest number of files; the oldest ones are deleted.
    """

    def __init__(self, folder: Path, *, width: int, max_files: int) -> None:
        self._folder, self._width, self._max_files = folder, width, max_files

    def get(self, key: str) -> Float32 | None:
        """Return the rows stored under `key`; None when there are none or the file is damaged."""
        try:
            with self._file(key).open("rb") as stream:
                rows = np.load(stream, allow_pickle=False)
        except (OSError, ValueError, EOFError):
            return None
        return rows if rows.dtype == np.float32 and rows.ndim == 2 and rows.shape[1] == self._width else None

    def put(self, key: str, rows: Float32) -> None:
        """Store `rows` under `key`; a file that cannot be written is logged and ignored."""
        try:
            with atomic_write(self._file(key)) as stream:
                np.save(stream, rows)
            files = sorted(self._folder.glob("*.npy"), key=lambda file: file.stat().st_mtime)
            for file in files[: -self._max_files]:
                file.unlink(missing_ok=True)
        except (DiskError, OSError) as error:
            _LOG.info("Rows are not stored: %s", error)

    def _file(self, key: str) -> Path:
        return self._folder / f"{key}.npy"
