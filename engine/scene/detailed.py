"""Detailed Gaussians of an object and their file in the object's folder. NumPy only, because the add-on reads them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FormatError
from ..core.files import ArraySpec, atomic_write, object_file, read_arrays
from .gaussians import Gaussians

_DETAIL = "detail.npz"
_ROWS, _TRAINED_MEANS, _PARENTS = "rows", "trained_means", "parents"
_VALUES = ("means", "log_scales", "quats", "opacity_logits", "sh")
_ARRAYS = {
    _ROWS: ArraySpec("int32", ("m",)),
    _TRAINED_MEANS: ArraySpec("float32", ("m", 3), finite=True),
    _PARENTS: ArraySpec("int32", ("n",)),
    "means": ArraySpec("float32", ("n", 3), finite=True),
    "log_scales": ArraySpec("float32", ("n", 3), finite=True),
    "quats": ArraySpec("float32", ("n", 4), finite=True),
    "opacity_logits": ArraySpec("float32", ("n",), finite=True),
    "sh": ArraySpec("float32", ("n", "n_sh", 3), finite=True),
}
_ADVICE = "Isolate the object again."


@dataclass(frozen=True)
class Detailed:
    """An object's Gaussians after `engine.objects.detail.detail_object`.

    Attributes
    ----------
    rows : array of shape [M], int32
        Indices of the object's Gaussians in the scene, ascending.
    trained_means : array of shape [M, 3], float32
        Their centres in the scene, in world units.
    parents : array of shape [K], int32
        For each detailed Gaussian, its Gaussian in the scene: one of `rows`. Ascending. Those of `rows` that do not
        occur are not shown.
    gaussians : Gaussians
        The K detailed Gaussians, without features.
    """

    rows: NDArray[np.int32]
    trained_means: NDArray[np.float32]
    parents: NDArray[np.int32]
    gaussians: Gaussians

    def of(self, kept: NDArray[np.bool_]) -> Detailed:
        """Return the detail of those of `rows` that `kept`, bool [M], selects."""
        rows = self.rows[kept]
        children = np.isin(self.parents, rows)
        return Detailed(rows, self.trained_means[kept], self.parents[children], self.gaussians[children])

    def with_detail(self, gaussians: Gaussians, rows: NDArray[np.integer]) -> tuple[Gaussians, NDArray[np.intp]]:
        """Return `gaussians`, which are `rows` [R] of the scene, with their detailed ones in their place.

        A Gaussian whose centre differs from its trained one was moved by the user and is not replaced.

        Returns
        -------
        gaussians : Gaussians
            L of them; in place of a Gaussian, all detailed ones that have it as their parent, with its features. There
            may be none. If none of `rows` has one, all stay as they are in the scene: nothing would be left.
        source : array of shape [L], intp
            For each, the place in the given Gaussians of itself or of its parent, ascending. What is known of a
            Gaussian, such as its membership, holds for those in its place.
        """
        if len(self.rows) == 0 or len(rows) == 0:
            return gaussians, np.arange(len(rows))
        place = np.minimum(np.searchsorted(self.rows, rows), len(self.rows) - 1)
        replaced = (self.rows[place] == rows) & (self.trained_means[place] == gaussians.means).all(axis=1)
        first, after = (np.searchsorted(self.parents, rows, side=side) for side in ("left", "right"))
        counts = np.where(replaced, after - first, 1)
        if not counts.any():
            return gaussians, np.arange(len(rows))
        source = np.repeat(np.arange(len(rows)), counts)
        number = np.arange(len(source)) - np.repeat(np.cumsum(counts) - counts, counts)
        is_detailed = replaced[source]
        child = (first[source] + number)[is_detailed]
        joined = gaussians[source]
        values = {}
        for name in _VALUES:
            values[name] = getattr(joined, name)
            values[name][is_detailed] = getattr(self.gaussians, name)[child]
        return replace(joined, **values), source


def save_detailed(folder: Path, detailed: Detailed) -> None:
    """Write `detailed` to an object's folder.

    Raises
    ------
    DiskError
        When the disk is full or read-only.
    """
    arrays: dict[str, Any] = {name: getattr(detailed.gaussians, name) for name in _VALUES}
    arrays |= {_ROWS: detailed.rows, _TRAINED_MEANS: detailed.trained_means, _PARENTS: detailed.parents}
    with atomic_write(folder / _DETAIL) as stream:
        np.savez(stream, **arrays)


def load_detailed(project: Path, object_id: str) -> Detailed | None:
    """Return the detailed Gaussians of an object, None when it has none.

    Raises
    ------
    FormatError
        When the file is damaged.
    """
    file = object_file(project, object_id, _DETAIL)
    return read_detailed(file.parent) if file.is_file() else None


def read_detailed(folder: Path) -> Detailed:
    """Return the detailed Gaussians that `save_detailed` wrote to a folder; raises as `load_detailed`."""
    file = folder / _DETAIL
    arrays = read_arrays(file, _ARRAYS, advice=_ADVICE)
    rows, parents = arrays[_ROWS], arrays[_PARENTS]
    if len(rows) and (rows[0] < 0 or (np.diff(rows) <= 0).any()):
        raise FormatError(f"{file} cannot be read: `{_ROWS}` is not ascending. {_ADVICE}")
    if not np.isin(parents, rows).all() or (np.diff(parents) < 0).any():
        raise FormatError(f"{file} cannot be read: `{_PARENTS}` are not of its `{_ROWS}`, ascending. {_ADVICE}")
    if arrays["sh"].shape[1] not in (1, 4, 9, 16):
        raise FormatError(f"{file} cannot be read: `sh` has an unexpected shape. {_ADVICE}")
    values: dict[str, Any] = {name: arrays[name] for name in _VALUES}
    return Detailed(rows, arrays[_TRAINED_MEANS], parents, Gaussians(**values))
