"""Rows of numbers that a model gave, kept from process to process: derived data, bounded, made anew when it is gone."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import DiskError
from ..project_folder import atomic_write

__all__ = ["KeptRows"]

_LOG = logging.getLogger(__name__)

Float32 = NDArray[np.float32]


class KeptRows:
    """Arrays of shape [n, `width`], float32, in a file each.

    Parameters
    ----------
    folder : Path
        Made when first needed.
    width : int
    most : int
        Files kept; the oldest goes first.
    """

    def __init__(self, folder: Path, *, width: int, most: int) -> None:
        self._folder, self._width, self._most = folder, width, most

    def get(self, key: str) -> Float32 | None:
        """Return the rows kept under `key`; None when there are none, or none that are whole."""
        try:
            with self._file(key).open("rb") as stream:
                rows = np.load(stream, allow_pickle=False)
        except (OSError, ValueError, EOFError):
            return None
        return rows if rows.dtype == np.float32 and rows.ndim == 2 and rows.shape[1] == self._width else None

    def put(self, key: str, rows: Float32) -> None:
        """Keep `rows` under `key`; a disk that refuses costs only time."""
        try:
            with atomic_write(self._file(key)) as stream:
                np.save(stream, rows)
            kept = sorted(self._folder.glob("*.npy"), key=lambda file: file.stat().st_mtime)
            for file in kept[: -self._most]:
                file.unlink(missing_ok=True)
        except (DiskError, OSError) as error:
            _LOG.info("Rows are not kept: %s", error)

    def _file(self, key: str) -> Path:
        return self._folder / f"{key}.npy"
