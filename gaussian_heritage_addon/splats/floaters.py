"""Floaters of an object: Gaussians that are isolated or faint. No bpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...engine.scene import Gaussians

_TYPICAL_NEIGHBOURS = 20
"""Gaussians, itself included, in the cell of the median Gaussian and the 26 cells around it."""
_MAX_STEPS = 40
"""Halvings of the size of the cells; float64 has no smaller ones."""
_EXTENT = 2.0
"""Standard deviations along its longest axis at which a Gaussian ends."""
_MIN_OBJECT = 30
"""Of fewer Gaussians, each is needed."""


def find_floaters(gaussians: Gaussians, *, min_neighbours: int = 3, min_opacity: float = 0.02) -> NDArray[np.bool_]:
    """Return which Gaussians of an object are floaters, shape [N].

    Parameters
    ----------
    min_neighbours : int
        A Gaussian with fewer others near it is isolated, unless its ellipsoid comes near that of one which is not. Near
        means within a cell or beside it, with cells so large that the median Gaussian has about 20 near it.
    min_opacity : float
        A Gaussian with a lower opacity is faint.
    """
    faint = gaussians.opacities < min_opacity
    if len(gaussians) < _MIN_OBJECT:
        return faint
    # Faint Gaussians are no neighbours: they often surround a floater.
    solid = np.flatnonzero(~faint)
    floaters = faint.copy()
    if len(solid) >= _MIN_OBJECT:
        means = gaussians.means[solid].astype(np.float64)
        counts, cell = _neighbours(means)
        alone = counts - 1 < min_neighbours
        sizes = _EXTENT * np.exp(gaussians.log_scales[solid].max(axis=1).astype(np.float64))
        alone[alone] = _gaps(means[alone], sizes[alone], means[~alone], sizes[~alone]) > cell
        floaters[solid] = alone
    return floaters


def _gaps(
    means: NDArray[np.float64],
    sizes: NDArray[np.float64],
    others: NDArray[np.float64],
    their_sizes: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the smallest gap between each Gaussian [K] and the others [M], as balls; infinity without others."""
    gaps = np.full(len(means), np.inf)
    for number, (mean, size) in enumerate(zip(means, sizes, strict=True)):
        if len(others):
            gaps[number] = (np.linalg.norm(others - mean, axis=1) - their_sizes).min() - size
    return gaps


def _neighbours(points: NDArray[np.float64]) -> tuple[NDArray[np.int64], float]:
    """Return the number of points, itself included, in the cell of each point and around it, and the cell's size."""
    size = float(np.ptp(points, axis=0).max())
    counts = np.full(len(points), len(points), np.int64)
    for _ in range(_MAX_STEPS):
        smaller = _counts(points, size / 2) if size > 0 else counts
        if np.median(smaller) < _TYPICAL_NEIGHBOURS:
            break
        counts, size = smaller, size / 2
    return counts, size


def _counts(points: NDArray[np.float64], size: float) -> NDArray[np.int64]:
    cells = np.floor((points - points.min(axis=0)) / size).astype(np.int64) + 1
    shape = cells.max(axis=0) + 2
    keys = (cells[:, 0] * shape[1] + cells[:, 1]) * shape[2] + cells[:, 2]
    known, inverse, per_cell = np.unique(keys, return_inverse=True, return_counts=True)
    total = np.zeros(len(known), np.int64)
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            for dz in (-1, 0, 1):
                wanted = known + (dx * shape[1] + dy) * shape[2] + dz
                place = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
                total += np.where(known[place] == wanted, per_cell[place], 0)
    counts: NDArray[np.int64] = total[inverse]
    return counts
