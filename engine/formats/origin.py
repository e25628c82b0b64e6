"""Coordinates far from 0, such as UTM: a point near them is taken off before they become float32, and put back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float64
from ..core.errors import FormatError
from ..scene import Gaussians

_FAR = 64.0
"""Distance from 0, in extents of the Gaussians, from which they are far: float32 then keeps 18 bits of the extent."""
_MOST_SAMPLED = 10_000
"""Positions of which the extent is found."""


def far_origin(points: NDArray[np.floating]) -> Float64:
    """Return the point to take off `points` [N, 3] before they become float32, [3]; 0 for axes on which they are near.

    Its numbers are whole and have the same value in float32, so that Blender's locations hold them. A hundredth of the
    points at each end, such as floaters, do not count.
    """
    sampled = points[:: max(1, len(points) // _MOST_SAMPLED)].astype(np.float64)
    if not len(sampled):
        return np.zeros(3)
    low, high = np.percentile(sampled, (1, 99), axis=0)
    middle, extent = (low + high) / 2, float((high - low).max())
    near = np.float32(np.round(middle)).astype(np.float64)
    return np.where(np.abs(middle) > _FAR * extent, near, 0.0)


def moved_far(gaussians: Gaussians, matrix: Float64) -> bool:
    """Return whether `matrix` [4, 4] takes Gaussians that are near 0 so far away that float32 rounds their places."""
    if not matrix[:3, 3].any() or not len(gaussians):
        return False
    step = max(1, len(gaussians) // _MOST_SAMPLED)
    own = gaussians.means[::step]
    there = own.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    rounded = np.abs(there.astype(np.float32) - there).max()
    spread = float(np.ptp(there, axis=0).max())
    # A single Gaussian, or several at one place, keep what float32 keeps of any number.
    return bool(spread and rounded * 2.0**18 > spread and far_origin(there).any() and not far_origin(own).any())


def require_near(gaussians: Gaussians, matrix: Float64 | None, path: object) -> None:
    """Raise `FormatError` where `matrix`, [4, 4], takes the Gaussians too far away for a file of float32 numbers."""
    if matrix is not None and moved_far(gaussians, matrix):
        place = ", ".join(f"{value:.0f}" for value in matrix[:3, 3])
        raise FormatError(
            f"{path} would have Gaussians around ({place}), where the float32 numbers of its format cannot hold their "
            "places. Export PLY, which holds them as doubles, or an object with its own origin."
        )
