"""Polished Gaussians of an object and their file in the object's folder. NumPy only, because the add-on reads them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FormatError
from ..core.files import ArraySpec, atomic_write, object_file, read_arrays
from .gaussians import Gaussians

__all__ = ["Polished", "load_polished", "save_polished"]

_POLISHED = "polished.npz"
_ROWS, _TRAINED_MEANS = "rows", "trained_means"
_VALUES = ("means", "log_scales", "quats", "opacity_logits", "sh")
_ARRAYS = {
    _ROWS: ArraySpec("int32", ("n",)),
    _TRAINED_MEANS: ArraySpec("float32", ("n", 3), finite=True),
    "means": ArraySpec("float32", ("n", 3), finite=True),
    "log_scales": ArraySpec("float32", ("n", 3), finite=True),
    "quats": ArraySpec("float32", ("n", 4), finite=True),
    "opacity_logits": ArraySpec("float32", ("n",), finite=True),
    "sh": ArraySpec("float32", ("n", "n_sh", 3), finite=True),
}
_ADVICE = "Isolate the object again."


@dataclass(frozen=True)
class Polished:
    """An object's Gaussians after `engine.objects.polishing.polish`.

    Attributes
    ----------
    rows : array of shape [M], int32
        Indices of the object's Gaussians in the scene, ascending.
    trained_means : array of shape [M, 3], float32
        Their centres before polishing, in world units.
    gaussians : Gaussians
        The M polished Gaussians, without features.
    """

    rows: NDArray[np.int32]
    trained_means: NDArray[np.float32]
    gaussians: Gaussians

    def with_polished(self, gaussians: Gaussians, rows: NDArray[np.integer]) -> Gaussians:
        """Return `gaussians`, which are `rows` [K] of the scene, with the polished ones replaced.

        A Gaussian whose centre differs from its trained one was moved by the user and is not replaced.
        """
        if len(self.rows) == 0:
            return gaussians
        place = np.minimum(np.searchsorted(self.rows, rows), len(self.rows) - 1)
        unmoved = (self.rows[place] == rows) & (self.trained_means[place] == gaussians.means).all(axis=1)
        replaced = {}
        for name in _VALUES:
            values = getattr(gaussians, name).copy()
            values[unmoved] = getattr(self.gaussians, name)[place[unmoved]]
            replaced[name] = values
        return replace(gaussians, **replaced)


def save_polished(folder: Path, polished: Polished) -> None:
    """Write `polished` to an object's folder.

    Raises
    ------
    DiskError
        When the disk is full or read-only.
    """
    arrays: dict[str, Any] = {name: getattr(polished.gaussians, name) for name in _VALUES}
    arrays |= {_ROWS: polished.rows, _TRAINED_MEANS: polished.trained_means}
    with atomic_write(folder / _POLISHED) as stream:
        np.savez(stream, **arrays)


def load_polished(project: Path, object_id: str) -> Polished | None:
    """Return the polished Gaussians of an object, None when it was not polished.

    Raises
    ------
    FormatError
        When the file is damaged.
    """
    file = object_file(project, object_id, _POLISHED)
    if not file.is_file():
        return None
    arrays = read_arrays(file, _ARRAYS, advice=_ADVICE)
    rows = arrays[_ROWS]
    if len(rows) and (rows[0] < 0 or (np.diff(rows) <= 0).any()):
        raise FormatError(f"{file} cannot be read: `{_ROWS}` is not ascending. {_ADVICE}")
    if arrays["sh"].shape[1] not in (1, 4, 9, 16):
        raise FormatError(f"{file} cannot be read: `sh` has an unexpected shape. {_ADVICE}")
    values: dict[str, Any] = {name: arrays[name] for name in _VALUES}
    return Polished(rows, arrays[_TRAINED_MEANS], Gaussians(**values))
