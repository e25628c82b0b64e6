"""Selection of Gaussians on plain arrays: cosine to a direction, connected components, convex hull."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

from ..pictures import normalized

__all__ = [
    "BELOW_HALF",
    "HALF",
    "RADIUS_PERCENTAGE",
    "calibrated",
    "connected_parts",
    "grid_components",
    "inside_hull",
    "mean_direction",
    "with_members",
    "within_quartiles",
    "without_far",
]

log = logging.getLogger(__name__)

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

HALF = np.float32(0.5)  # by definition
"""Membership from which on a Gaussian belongs to an object."""

BELOW_HALF = np.nextafter(HALF, np.float32(0))  # by definition
"""Largest membership of a Gaussian that does not belong."""

_N_DIRECTION_ROUNDS = 3  # chosen on museum_room
"""Times that the outliers of a mean direction are removed."""

_NEARBY_MARGIN = 0.25  # chosen on museum_room
"""Margin around an object within which the threshold can add Gaussians, as a share of its extent along each axis."""

RADIUS_PERCENTAGE = 90  # chosen on museum_room, store_room
"""Percentage of the Gaussians of an object or a mask that its radius holds. Others may lie on what shines through."""

_MAX_MEMBER_RADII = 4.0  # chosen on museum_room, room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Distance from the middle of an object beyond which a member is dropped, in radii."""

_CELL_LINK_DISTANCE = 1.8  # by definition
"""Distance in cells up to which two cells of a grid are linked; above sqrt(3), which reaches the 26 cells around."""


def mean_direction(
    features: Float32, *, start: Float32 | None = None, cosine: float = 0.7
) -> Float32 | None:  # published: Dahaghin et al. 2024
    """Return the mean direction of features without outliers.

    Parameters
    ----------
    features : array of shape [P, D], float32
        Features of a mask's pixels, at unit length.
    start : array of shape [D], float32, optional
        Unit vector to start from, e.g. the feature of the clicked pixel; by default the mean of the features.
    cosine : float
        In each of three rounds, features with a smaller cosine to the current direction are left out of the mean.

    Returns
    -------
    array of shape [D], float32, or None
        A unit vector; None without features or if they cancel out.
    """
    if len(features) == 0:
        return None
    direction = normalized(features.mean(axis=0)) if start is None else start
    for _ in range(_N_DIRECTION_ROUNDS):
        near = features @ direction >= cosine
        if not near.any():
            break
        direction = normalized(features[near].mean(axis=0))
    return direction if np.abs(direction).sum() > 0 else None


def calibrated(cosine: NDArray[np.floating], threshold: float) -> Float32:
    """Map cosines to memberships, piecewise linearly: -1 to 0, `threshold` to exactly 0.5 and 1 to 1."""
    cosine = np.asarray(cosine, np.float32)
    above = 0.5 + 0.5 * (cosine - np.float32(threshold)) / np.float32(1 - threshold)
    below = 0.5 * (cosine + 1) / np.float32(1 + threshold)
    # Rounding must not bring a cosine below the threshold to 0.5.
    below = np.minimum(below, BELOW_HALF)
    return np.clip(np.where(cosine >= np.float32(threshold), above, below), 0, 1).astype(np.float32)


def with_members(membership: Float32, members: Mask) -> Float32:
    """Return `membership`, [N], raised to 0.5 for `members`, bool [N], and lowered below 0.5 for all others."""
    below = np.minimum(membership, BELOW_HALF)
    return np.where(members, np.maximum(membership, HALF), below).astype(np.float32)


def grid_components(points: Float32, cell: float) -> NDArray[np.integer]:
    """Return the connected component of each point, linked through the occupied cells of a grid.

    Parameters
    ----------
    points : array of shape [M, 3], float32
    cell : float
        Side of a cell. Points in the same cell or in two cells that touch are connected.

    Returns
    -------
    integer array of shape [M]
        Components are numbered from 0.
    """
    keys, cell_of = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_inverse=True)
    pairs = cKDTree(keys).query_pairs(_CELL_LINK_DISTANCE, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(keys), len(keys)))
    components: NDArray[np.integer] = connected_components(links, directed=False)[1][cell_of.reshape(-1)]
    return components


def connected_parts(
    points: Float32, evidence_weights: NDArray[np.floating], *, least_share: float = 0.1
) -> Mask:  # chosen on museum_room
    """Return the connected components that the evidence mask shows.

    Points are connected through neighbouring cells of a grid. A cell is as wide as a tenth of the radius of the part
    that the mask shows, and at least twice the usual distance between neighbours. The component with the largest total
    weight is kept, and every other one with at least `least_share` of it: an occluder may split an object in two.

    Parameters
    ----------
    points : array of shape [M, 3], float32
    evidence_weights : array of shape [M], float
        Pixels of the evidence mask that each point contributes.
    least_share : float
        Smallest total weight of a component, as a share of the largest one.

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
    part = grid_components(points, cell)
    weight = np.bincount(part, weights=evidence_weights)
    return np.asarray((weight >= least_share * weight.max())[part] & (weight > 0)[part])


def within_quartiles(points: Float32, factor: float) -> Mask:
    """Return which points are within `factor` interquartile ranges of the quartiles on every axis, bool [M]."""
    if len(points) == 0:
        return np.zeros(0, bool)
    first, third = np.percentile(points, [25, 75], axis=0)
    reach = factor * (third - first)
    return np.asarray(((points >= first - reach) & (points <= third + reach)).all(axis=1))


def inside_hull(corners: Float32, points: Float32) -> Mask:
    """Return which points are inside the convex hull of `corners`.

    Parameters
    ----------
    corners : array of shape [M, 3], float32
    points : array of shape [N, 3], float32

    Returns
    -------
    bool array of shape [N]
        All False if the hull has no volume (fewer than four corners, or all on one plane).
    """
    inside = np.zeros(len(points), bool)
    if len(corners) < 4:
        return inside
    try:
        hull = ConvexHull(corners.astype(np.float64))
    except QhullError:
        log.info("The %d Gaussians found are on one plane and have no convex hull to fill.", len(corners))
        return inside
    near = np.flatnonzero(((points >= corners.min(axis=0)) & (points <= corners.max(axis=0))).all(axis=1))
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    # In pieces to bound memory: a hull may have thousands of faces and a scene a million Gaussians.
    for piece in np.array_split(near, max(1, len(near) // 4096)):
        inside[piece] = (points[piece].astype(np.float64) @ normals.T + offsets <= 0).all(axis=1)
    return inside


def without_far(means: Float32, membership: Float32, members: Mask) -> Float32:
    """Return a membership that is above 0 only on an object and next to it.

    Single members far from the others are dropped. Other Gaussians stay below 0.5 next to the members, where the
    threshold slider can add them, and get 0 elsewhere.

    Parameters
    ----------
    means : array of shape [N, 3], float32
    membership : array of shape [N], float32
    members : bool array of shape [N]

    Returns
    -------
    array of shape [N], float32
        Zeros without members.
    """
    rows = np.flatnonzero(members)
    if len(rows) == 0:
        return np.zeros_like(membership)
    points = means[rows]
    distances = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    near = distances <= _MAX_MEMBER_RADII * np.percentile(distances, RADIUS_PERCENTAGE)
    low, high = points[near].min(axis=0), points[near].max(axis=0)
    margin = _NEARBY_MARGIN * (high - low)
    nearby = ((means >= low - margin) & (means <= high + margin)).all(axis=1)
    result = np.where(nearby, np.minimum(membership, BELOW_HALF), np.float32(0)).astype(np.float32)
    result[rows] = np.where(near, membership[rows], np.float32(0))
    return result
