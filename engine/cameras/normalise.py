"""Normalisation of a reconstruction: Z up, origin where the photos look, cameras at unit distance.

Frames: `original_from_world` maps the normalised world (right-handed, Z up) to the frame of the poses as estimated or
given, whose unit and axes are arbitrary. View matrices are world-to-camera with x right, y down, z forward.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float64

_MIN_MEAN_LENGTH = 0.3
"""A mean of unit vectors that is shorter than this does not define a direction."""
_MAX_ROLL = np.sin(np.radians(30.0))
"""Cameras rolled by more than this (sine of the angle) are not used to determine the up direction."""


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
        ``[[s R, t], [0, 1]]`` with a rotation R, for a right-handed world with Z up. Its origin is the point closest
        to all optical axes (robustly) when it lies in front of at least 90 % of the cameras, else the median of the
        points. Its scale makes the median distance of the cameras from the origin 1, so that an object that fills the
        photos has a size of about 0.5 to 1, independent of the background. When all cameras are in one place, the
        median distance of the points is 1.

    Notes
    -----
    All sums are relative to the mean camera position, so that georeferenced coordinates (4.5e6 m) keep their precision.
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
    """Return the world-to-camera matrix [4, 4] for the normalised world, with camera coordinates in its unit."""
    scale = np.cbrt(np.linalg.det(similarity[:3, :3]))
    rotation = viewmat[:3, :3]
    center = -rotation.T @ viewmat[:3, 3]
    moved = np.eye(4)
    moved[:3, :3] = rotation @ similarity[:3, :3] / scale
    # Computed from the camera's centre: t and R t are each as large as georeferenced coordinates and would cancel.
    moved[:3, 3] = rotation @ (similarity[:3, 3] - center) / scale
    return moved


def normalised_points(points: Float64, similarity: Float64) -> NDArray[np.float32]:
    """Return `points` [P, 3] of the original frame, in the normalised world as float32."""
    local = (points - similarity[:3, 3]) @ np.linalg.inv(similarity[:3, :3]).T
    return local.astype(np.float32)


def _up(rotations: Float64) -> Float64:
    """Return the up direction as a unit vector, estimated from the orientation of the cameras.

    The mean of the pictures' up directions gives an estimate. It is refined to the direction most perpendicular to the
    x axes of all cameras, which are horizontal for cameras held level; this needs cameras that look in different
    directions. Portrait photos without EXIF orientation have a vertical x axis and are ignored.
    """
    estimate = _mean_up(rotations)
    right = rotations[:, 0]
    up = estimate
    for _ in range(3):
        level = right[np.abs(right @ up) < _MAX_ROLL]
        if len(level) < 3:
            return estimate
        values, vectors = np.linalg.eigh(level.T @ level / len(level))
        # With nearly parallel x axes every direction perpendicular to them fits; the mean is more reliable.
        if values[1] < 0.05 or values[0] > 0.5 * values[1]:
            return estimate
        up = vectors[:, 0] * np.sign(vectors[:, 0] @ estimate or 1.0)
    return up if up @ estimate > 0.5 else estimate


def _mean_up(rotations: Float64) -> Float64:
    for candidates in (-rotations[:, 1], -rotations[:, 2]):
        # Photos taken straight down with all headings have no common up in the picture; up is then against the view.
        mean = candidates.mean(axis=0)
        length = float(np.linalg.norm(mean))
        if length > _MIN_MEAN_LENGTH:
            direction: Float64 = mean / length
            return direction
    first: Float64 = -rotations[0, 1]
    return first


def _center(axes: Float64, centers: Float64, points: Float64) -> Float64:
    """Return the origin of the normalised world, see `original_from_world`."""
    fallback: Float64 = np.median(points, axis=0) if len(points) else centers.mean(axis=0)
    weights = np.ones(len(axes))
    center = fallback
    for _ in range(10):
        across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
        normal = np.einsum("c,cij->ij", weights, across) / weights.sum()
        if np.linalg.eigvalsh(normal)[0] < 0.01:
            return fallback  # axes are nearly parallel
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
    """Return a rotation [3, 3] with the world's axes as columns: Z up, Y along the first camera's view direction."""
    forward = first_rotation[2] - (first_rotation[2] @ up) * up
    if np.linalg.norm(forward) < 0.1:
        # The first camera looks straight down or up: the up direction of its picture is forward instead.
        forward = -first_rotation[1] + (first_rotation[1] @ up) * up
    y = forward / np.linalg.norm(forward)
    return np.stack([np.cross(y, up), y, up], axis=1)
