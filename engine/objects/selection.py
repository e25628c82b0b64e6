"""Which Gaussians belong to a direction in feature space: cosine, connected part, completion. Arrays in, arrays out."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

from ..pictures import normalized

__all__ = [
    "calibrated",
    "connected_parts",
    "inside_hull",
    "iou_of",
    "mean_direction",
    "with_members",
    "within_quartiles",
]

log = logging.getLogger(__name__)

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_ROUNDS = 3


def mean_direction(features: Float32, *, start: Float32 | None = None, cosine: float = 0.7) -> Float32 | None:
    """Return the direction most of the features share: their mean, again without those that point elsewhere.

    Parameters
    ----------
    features : array of shape [P, D], float32
        At unit length; pixels of a mask.
    start : array of shape [D], float32, optional
        Unit vector to begin with, e.g. the feature of the clicked pixel; the features' mean by default.
    cosine : float
        In each of three rounds, features below it to the direction so far are set aside.

    Returns
    -------
    array of shape [D], float32, or None
        A unit vector; None without features or when they cancel out.
    """
    if len(features) == 0:
        return None
    direction = normalized(features.mean(axis=0)) if start is None else start
    for _ in range(_ROUNDS):
        near = features @ direction >= cosine
        if not near.any():
            break
        direction = normalized(features[near].mean(axis=0))
    return direction if np.abs(direction).sum() > 0 else None


def calibrated(cosine: NDArray[np.floating], threshold: float) -> Float32:
    """Return cosines as memberships in [0, 1]: -1 becomes 0, `threshold` exactly 0.5, 1 becomes 1, straight between."""
    cosine = np.asarray(cosine, np.float32)
    above = 0.5 + 0.5 * (cosine - np.float32(threshold)) / np.float32(1 - threshold)
    below = 0.5 * (cosine + 1) / np.float32(1 + threshold)
    # Rounding must not bring a cosine below the threshold to 0.5.
    below = np.minimum(below, np.nextafter(np.float32(0.5), np.float32(0)))
    return np.clip(np.where(cosine >= np.float32(threshold), above, below), 0, 1).astype(np.float32)


def iou_of(one: Mask, other: Mask) -> float:
    """Return the intersection over union of two sets of Gaussians, bool [N]; 0 of two empty ones."""
    return float((one & other).sum() / max(1, (one | other).sum()))


def with_members(membership: Float32, members: Mask) -> Float32:
    """Return the membership, [N], in which exactly `members`, bool [N], belong: 0.5 at least, what is beside below."""
    half = np.float32(0.5)
    below = np.minimum(membership, np.nextafter(half, np.float32(0)))
    return np.where(members, np.maximum(membership, half), below).astype(np.float32)


def connected_parts(points: Float32, seed_mass: NDArray[np.floating], *, least_share: float = 0.1) -> Mask:
    """Return the points that hang together with what the seed sees.

    Points are linked through neighbouring cells of a grid, as wide as a tenth of the seen part's radius and at least
    twice the usual distance between neighbours. Kept are the part with most seed mass and every other part with at
    least `least_share` of it (an object cut in two by something before it).

    Parameters
    ----------
    points : array of shape [M, 3], float32
    seed_mass : array of shape [M], float
        How much of the seed mask each point makes up.
    least_share : float

    Returns
    -------
    bool array of shape [M]
        All True when the seed sees none of them.
    """
    total = float(seed_mass.sum())
    if len(points) < 3 or total <= 0:
        return np.ones(len(points), bool)
    share = seed_mass.astype(np.float64) / total
    center = share @ points
    radius = float(np.sqrt(share @ ((points - center) ** 2).sum(axis=1)))
    neighbours = cKDTree(points).query(points, k=min(4, len(points)))[0][:, -1]
    cell = max(0.1 * radius, 2 * float(np.median(neighbours)), 1e-9)
    keys, part_of = np.unique(np.floor(points / cell).astype(np.int64), axis=0, return_inverse=True)
    # sqrt(3) reaches the 26 cells around.
    pairs = cKDTree(keys).query_pairs(1.8, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(keys), len(keys)))
    part = connected_components(links, directed=False)[1][part_of.reshape(-1)]
    mass = np.bincount(part, weights=seed_mass)
    return np.asarray((mass >= least_share * mass.max())[part] & (mass > 0)[part])


def within_quartiles(points: Float32, factor: float) -> Mask:
    """Return the points within `factor` interquartile ranges of the quartiles on every axis, bool [M]."""
    if len(points) == 0:
        return np.zeros(0, bool)
    first, third = np.percentile(points, [25, 75], axis=0)
    reach = factor * (third - first)
    return np.asarray(((points >= first - reach) & (points <= third + reach)).all(axis=1))


def inside_hull(corners: Float32, points: Float32) -> Mask:
    """Return which points lie in the convex hull of `corners`.

    Parameters
    ----------
    corners : array of shape [M, 3], float32
    points : array of shape [N, 3], float32

    Returns
    -------
    bool array of shape [N]
        All False when the corners have no volume (fewer than four, or on one plane).
    """
    inside = np.zeros(len(points), bool)
    if len(corners) < 4:
        return inside
    try:
        hull = ConvexHull(corners.astype(np.float64))
    except QhullError:
        log.info("The %d Gaussians found lie on one plane; there is no hull to fill.", len(corners))
        return inside
    near = np.flatnonzero(((points >= corners.min(axis=0)) & (points <= corners.max(axis=0))).all(axis=1))
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    # In pieces: a hull may have thousands of faces and a scene a million Gaussians.
    for piece in np.array_split(near, max(1, len(near) // 4096)):
        inside[piece] = (points[piece].astype(np.float64) @ normals.T + offsets <= 0).all(axis=1)
    return inside
