"""The world turned upright, centred on what the photos look at, and brought to unit size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["normalised_viewmat", "normalised_points", "original_from_world"]

Float64 = NDArray[np.float64]

# A mean of unit vectors shorter than this points nowhere in particular.
_CLEAR_DIRECTION = 0.3
_LEVEL_WITHIN = np.sin(np.radians(30.0))


def original_from_world(viewmats: Sequence[Float64], points: Float64) -> Float64:
    """Return the similarity from the normalised world to the frame of `viewmats`.

    Parameters
    ----------
    viewmats : sequence of arrays of shape [4, 4], float64
        World-to-camera, at least one.
    points : array of shape [P, 3], float64
        Sparse points in the same frame; may be empty.

    Returns
    -------
    array of shape [4, 4], float64
        ``[[s R, t], [0, 1]]``: right-handed, the world's Z up. Origin: the point closest to all optical axes
        (robustly), when the axes cross in front of nine cameras in ten, else the median of the points. Scale: the
        median distance of the cameras from the origin is 1, so an object that fills the photos measures about 0.5 to
        1, however far its background reaches (all cameras in one place: the median distance of the points).

    Notes
    -----
    All sums are taken around the mean camera position, so that georeferenced origins (4.5e6 m) lose no digits.
    """
    rotations = np.stack([viewmat[:3, :3] for viewmat in viewmats])
    centers = np.stack([-viewmat[:3, :3].T @ viewmat[:3, 3] for viewmat in viewmats])
    offset = centers.mean(axis=0)
    local_centers, local_points = centers - offset, points - offset
    up = _up(rotations)
    center = _center(rotations[:, 2], local_centers, local_points)
    similarity = np.eye(4)
    similarity[:3, :3] = _size(local_centers - center, local_points - center) * _axes(up, rotations[0])
    similarity[:3, 3] = center + offset
    return similarity


def normalised_viewmat(viewmat: Float64, similarity: Float64) -> Float64:
    """Return world-to-camera [4, 4] for the normalised world; lengths in the camera's frame shrink by the scale too."""
    scale = np.cbrt(np.linalg.det(similarity[:3, :3]))
    rotation = viewmat[:3, :3]
    center = -rotation.T @ viewmat[:3, 3]
    moved = np.eye(4)
    moved[:3, :3] = rotation @ similarity[:3, :3] / scale
    # Through the camera's centre: t and R t are each as large as the georeferenced origin and cancel.
    moved[:3, 3] = rotation @ (similarity[:3, 3] - center) / scale
    return moved


def normalised_points(points: Float64, similarity: Float64) -> NDArray[np.float32]:
    """Return `points` [P, 3] of the original frame in the normalised world, as float32."""
    local = (points - similarity[:3, 3]) @ np.linalg.inv(similarity[:3, :3]).T
    return local.astype(np.float32)


def _up(rotations: Float64) -> Float64:
    """Return the unit vector that people call up, from how cameras are held.

    The mean of the pictures' up directions says which way; for a camera that is held level its x axis is horizontal,
    so the direction most perpendicular to all x axes says it exactly, wherever the cameras look in different
    directions. Photos held upright without saying so (no EXIF) have a vertical x axis and are left out.
    """
    rough = _rough_up(rotations)
    right = rotations[:, 0]
    up = rough
    for _ in range(3):
        level = right[np.abs(right @ up) < _LEVEL_WITHIN]
        if len(level) < 3:
            return rough
        values, vectors = np.linalg.eigh(level.T @ level / len(level))
        # All x axes alike: any direction perpendicular to them fits, and the mean knows better.
        if values[1] < 0.05 or values[0] > 0.5 * values[1]:
            return rough
        up = vectors[:, 0] * np.sign(vectors[:, 0] @ rough or 1.0)
    return up if up @ rough > 0.5 else rough


def _rough_up(rotations: Float64) -> Float64:
    for candidates in (-rotations[:, 1], -rotations[:, 2]):
        # Pictures taken straight down all around have no common up in them; then up is where they look from.
        mean = candidates.mean(axis=0)
        length = float(np.linalg.norm(mean))
        if length > _CLEAR_DIRECTION:
            direction: Float64 = mean / length
            return direction
    first: Float64 = -rotations[0, 1]
    return first


def _center(axes: Float64, centers: Float64, points: Float64) -> Float64:
    """Return the point the cameras look at, see `original_from_world`."""
    fallback: Float64 = np.median(points, axis=0) if len(points) else centers.mean(axis=0)
    weights = np.ones(len(axes))
    center = fallback
    for _ in range(10):
        across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
        normal = np.einsum("c,cij->ij", weights, across) / weights.sum()
        if np.linalg.eigvalsh(normal)[0] < 0.01:
            return fallback  # axes (nearly) parallel
        center = np.linalg.solve(normal, np.einsum("c,cij,cj->i", weights, across, centers) / weights.sum())
        away = np.linalg.norm(np.einsum("cij,cj->ci", across, center - centers), axis=1)
        weights = 1.0 / np.maximum(away, 1e-3 * np.linalg.norm(center - centers, axis=1) + 1e-300)
    in_front = np.einsum("ci,ci->c", center - centers, axes) > 0.0
    return center if in_front.mean() >= 0.9 else fallback


def _size(from_center: Float64, points_from_center: Float64) -> float:
    for vectors in (from_center, points_from_center):
        if len(vectors):
            size = float(np.median(np.linalg.norm(vectors, axis=1)))
            if np.isfinite(size) and size > 1e-9 * (1.0 + float(np.abs(vectors).max())):
                return size
    return 1.0


def _axes(up: Float64, first_rotation: Float64) -> Float64:
    """Return a rotation [3, 3] with the world's axes as columns: Z up, and Y the way the first camera looks."""
    forward = first_rotation[2] - (first_rotation[2] @ up) * up
    if np.linalg.norm(forward) < 0.1:
        # The first camera looks straight down or up: its picture's upper edge points forward instead.
        forward = -first_rotation[1] + (first_rotation[1] @ up) * up
    y = forward / np.linalg.norm(forward)
    return np.stack([np.cross(y, up), y, up], axis=1)
