"""Where a scene ends and where an object stands: boxes that single Gaussians far away do not move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .camera import CameraSet
from .gaussians import Gaussians

_TAILS = (0.01, 0.99)
"""Quantiles of the positions that count as the ends of an object."""
_NEAR_SHARE = 0.99
"""Share of the sparse points within the radius of a scene; the others may be wrong matches."""
_FAR = 1.25  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Radii of a scene beyond which a Gaussian is far. Up to 2, nearly the same ones are; viewers then show more void."""

_FAR_REACH = 1.5  # chosen on museum_room
"""The same for the two standard deviations along the longest axis, which viewers count as the size of a Gaussian."""


def box_of(means: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the two corners of the box, [3] each, of positions [N, 3], at least one, without their tails."""
    low, high = np.quantile(means, _TAILS, axis=0)
    return low, high


def bottom_middle(means: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the middle of the bottom of an object, shape [3], from the positions [N, 3] of its Gaussians."""
    low, high = box_of(means)
    return np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])


def far_gaussians(gaussians: Gaussians, camera_set: CameraSet) -> NDArray[np.bool_]:
    """Return which Gaussians lie, or reach, far outside of what the photos measured, shape [N].

    These are more than a quarter farther from the middle of the sparse points than all cameras and 99 % of the points,
    or would reach half as far again if they were as large in all directions as in one. Photos show them in few pixels
    or from one side, so that their distance is hardly known; a viewer that frames everything, and takes all for balls,
    shows the scene as a dot in their midst. Without sparse points nothing is far.
    """
    points = camera_set.points
    if len(points) == 0:
        return np.zeros(len(gaussians), bool)
    middle = np.median(points, axis=0)
    centers = np.array([camera.center for camera in camera_set.cameras]).reshape(-1, 3)
    reach = float(np.quantile(np.linalg.norm(points - middle, axis=1), _NEAR_SHARE))
    radius = max(reach, *np.linalg.norm(centers - middle, axis=1))
    distances = np.linalg.norm(gaussians.means - middle, axis=1)
    reaches = distances + 2 * gaussians.scales.max(axis=1)
    return (distances > _FAR * radius) | (reaches > _FAR_REACH * radius)
