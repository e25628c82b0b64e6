"""Connected components of Gaussians that a mask shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

__all__ = ["connected_parts"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_LEAST_SHARE = 0.1  # chosen on museum_room
"""Smallest weight of a connected component that is kept, as a share of the largest one."""

_CELL_LINK_DISTANCE = 1.8  # by definition
"""Distance in cells up to which two cells of a grid are linked; above sqrt(3), which reaches the 26 cells around."""


def connected_parts(points: Float32, evidence_weights: NDArray[np.floating]) -> Mask:
    """Return the connected components that the evidence mask shows.

    Points are connected through neighbouring cells of a grid. A cell is as wide as a tenth of the radius of the part
    that the mask shows, and at least twice the usual distance between neighbours. The component with the largest total
    weight is kept, and every other one with at least a tenth of it: an occluder may split an object in two.

    Parameters
    ----------
    points : array of shape [M, 3], float32
    evidence_weights : array of shape [M], float
        Pixels of the evidence mask that each point contributes.

    Returns
    -------
    bool array of shape [M]
        All True if the mask shows none of the points.
    """
    total = float(evidence_weights.sum())
    if len(points) < 3 or total <= 0:
        return np.ones(len(points), bool)
    share = evidence_weights.astype(np.float64) / total
    center = share @ points
    radius = float(np.sqrt(share @ ((points - center) ** 2).sum(axis=1)))
    neighbours = cKDTree(points).query(points, k=min(4, len(points)))[0][:, -1]
    cell = max(0.1 * radius, 2 * float(np.median(neighbours)), 1e-9)
    # Linked through the occupied cells of the grid.
    keys, cell_of = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_inverse=True)
    pairs = cKDTree(keys).query_pairs(_CELL_LINK_DISTANCE, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(keys), len(keys)))
    part = connected_components(links, directed=False)[1][cell_of.reshape(-1)]
    weight = np.bincount(part, weights=evidence_weights)
    return np.asarray((weight >= _LEAST_SHARE * weight.max())[part] & (weight > 0)[part])
