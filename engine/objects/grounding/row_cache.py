"""A cache of a model's output rows on disk: derived data of limited size, computed again when a file is missing."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np

from ...core.arrays import Float32
from ...core.errors import DiskError, FormatError
from ...core.files import ArraySpec, atomic_write, delete_derived, read_array

_LOG = logging.getLogger(__name__)


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
        spec = ArraySpec("float32", ("n", self._width), finite=True)
        try:
            return read_array(self._file(key), spec, advice="It is computed again.")
        except FormatError:
            return None

    def put(self, key: str, rows: Float32) -> None:
        """Store `rows` under `key`; a file that cannot be written is logged and ignored."""
        try:
            with atomic_write(self._file(key)) as stream:
                np.save(stream, rows)
            files = sorted(self._folder.glob("*.npy"), key=lambda file: file.stat().st_mtime)
            for file in files[: -self._max_files]:
                delete_derived(self._folder, file.name)
        except (DiskError, FormatError, OSError) as error:
            _LOG.info("Rows are not stored: %s", error)

    def _file(self, key: str) -> Path:
        return self._folder / f"{key}.npy"
