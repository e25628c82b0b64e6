"""The Gaussians in a region that was drawn over a view: all, or those of the surface that is seen. No bpy."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float64
from ...engine.core.errors import PromptError
from ...engine.scene import Gaussians, RayCaster
from .sight import inside_polygon

_GRID = 24
"""Rays along each side of the box around a region; the surface is found between them by the nearest one."""
_DEPTH = 2.0
"""Standard deviations behind the surface at which the centre of a Gaussian still belongs to it."""
_MIN_DEPTH_SHARE = 0.01
"""The same as a share of the distance to the surface: rays of the grid do not hit each Gaussian."""


class View(Protocol):
    """A view of the Gaussians: a `Sight`, or a photo."""

    def ray(self, x: float, y: float) -> tuple[Float64, Float64]:
        """Return origin and unit direction of the ray at a position."""

    def positions(self, points: NDArray[np.floating]) -> Float64:
        """Return the positions [N, 2] of points [N, 3]."""


def in_region(view: View, gaussians: Gaussians, corners: Float64, *, through: bool) -> NDArray[np.bool_]:
    """Return which Gaussians lie in a region, shape [N].

    Parameters
    ----------
    gaussians : Gaussians
        Those that are shown, in the world of the view.
    corners : array of shape [C, 2]
        Positions of the region's corners in the view.
    through : bool
        Take all whose centre lies in the region; otherwise only those of the surface that is seen.

    Raises
    ------
    PromptError
        When the region has no area.
    """
    spread = np.ptp(corners, axis=0) if len(corners) else np.zeros(2)
    if len(corners) < 3 or spread.min() < 1.0:
        raise PromptError("The region is too small. Draw around what you mean, with the mouse button held.")
    places = view.positions(gaussians.means)
    chosen = inside_polygon(places, corners)
    if through or not chosen.any():
        return chosen
    candidates = np.flatnonzero(chosen)
    grid, to_surface = _surface(view, gaussians, places, corners)
    nearest = _nearest(places[candidates], grid)
    origins = np.array([view.ray(*place)[0] for place in grid])[nearest]
    distances = np.linalg.norm(gaussians.means[candidates] - origins, axis=1)
    sizes = np.exp(gaussians.log_scales[candidates].max(axis=1).astype(np.float64))
    limit = to_surface[nearest]
    # Where a ray meets no surface, nothing hides what is there.
    chosen[candidates] = ~(distances > limit + np.maximum(_DEPTH * sizes, _MIN_DEPTH_SHARE * limit))
    return chosen


def _surface(view: View, gaussians: Gaussians, places: Float64, corners: Float64) -> tuple[Float64, Float64]:
    """Return places [P, 2] of a grid in the region, and the distances [P] of the surface there."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    axes = [np.linspace(low[axis], high[axis], _GRID) for axis in range(2)]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    inside = inside_polygon(grid, corners)
    grid = grid[inside] if inside.any() else grid
    caster = RayCaster(gaussians[_may_cover(view, gaussians, places, low, high)])
    distances = [caster.cast(*view.ray(*place)).surface for place in grid]
    return grid, np.array([np.inf if one is None else one for one in distances])


def _may_cover(view: View, gaussians: Gaussians, places: Float64, low: Float64, high: Float64) -> NDArray[np.bool_]:
    """Return which Gaussians may be seen within the box from `low` to `high`: rays are cast through these only."""
    _, direction = view.ray(*((low + high) / 2))
    side = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    side /= np.linalg.norm(side)
    # Four standard deviations cover more than the largest reach of a Gaussian, 3.3.
    reach = 4.0 * np.exp(gaussians.log_scales.max(axis=1).astype(np.float64))
    radius = np.linalg.norm(view.positions(gaussians.means + reach[:, None] * side) - places, axis=1)
    near: NDArray[np.bool_] = ((places >= low - radius[:, None]) & (places <= high + radius[:, None])).all(axis=1)
    # A Gaussian that reaches behind the eye has no radius.
    return near | (np.isfinite(places).all(axis=1) & ~np.isfinite(radius))


def _nearest(points: Float64, others: Float64) -> NDArray[np.intp]:
    """Return for each point [N, 2] the index of the nearest of `others` [P, 2]."""
    nearest = np.empty(len(points), np.intp)
    for start in range(0, len(points), 4096):
        part = points[start : start + 4096]
        nearest[start : start + 4096] = ((part[:, None] - others[None]) ** 2).sum(axis=2).argmin(axis=1)
    return nearest
