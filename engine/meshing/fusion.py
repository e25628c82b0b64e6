"""Depths of many photos become one field of signed distances on a grid, and which of it photos saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.ndimage import gaussian_filter
from scipy.spatial import ConvexHull, QhullError

from ..core.arrays import Float32, Float64, Mask
from ..core.errors import Cancelled, ObjectError
from ..core.events import StopCheck
from ..rasterizer import JIT, Share, run_shared, take_range
from .depth import DepthMap, surface_points

_MAX_VOXELS = 8_000_000
"""Largest grid: 4 bytes for each of its voxels in four arrays."""

_VOXELS_PER_PIXEL = 1.0
"""Size of a voxel, relative to that of a pixel of the maps on the surface, where the grid is not too large then."""

_TAIL = 0.001
"""Share of the surface's points, at each end of an axis, that the box leaves out: single floaters."""

_MARGIN = 6
"""Voxels around that box."""

_BAND = 4.0
"""Voxels before the surface over which the distance is measured: as far as depths of photos differ."""

_BEHIND = 1.5
"""Voxels behind the surface over which a photo counts fully. Over the rest of the band it counts less and less: a thin
sheet would otherwise be pushed outward by the photos of its other side."""

_MAX_SPREAD = 0.08  # chosen on museum_room
"""Standard deviation of the depths in a pixel, as a share of the object's size, above which it is not used: it blends
a front with something far behind."""

_SMOOTH = 0.7
"""Standard deviation of the smoothing of the fused distances, in voxels."""

_MIN_WEIGHT = 0.5
"""Votes of photos, after smoothing, from which on a voxel counts as seen."""

_HULL_DIRECTIONS = 160
"""Directions in which the hull of the seen surface is measured."""

_COLUMNS_PER_RANGE = 16
"""Columns of voxels that a thread processes before it takes the next ones."""


@dataclass(frozen=True)
class Field:
    """A grid of voxels.

    Attributes
    ----------
    origin : array of shape [3], float64
        Place of the voxel 0, 0, 0, in world units.
    voxel : float
        Distance of neighbouring voxels, world units.
    values : array of shape [X, Y, Z], float32
        Signed distance to the surface in bands, -1 to 1, positive outside.
    seen : array of shape [X, Y, Z], bool
        Where photos measured it. Elsewhere the value is 1, or what `with_unseen_filled` made.
    """

    origin: Float64
    voxel: float
    values: Float32
    seen: Mask

    def places(self, grid_points: Float64) -> Float64:
        """Return places in the world, [P, 3], of points in units of voxels."""
        return self.origin + grid_points * self.voxel


def fuse(maps: Sequence[DepthMap], *, should_stop: StopCheck, max_voxels: int = _MAX_VOXELS) -> Field:
    """Return the field that the maps agree on.

    Parameters
    ----------
    maps : sequence of DepthMap
        At least one.
    max_voxels : int
        Largest grid.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    ObjectError
        When the photos show no extent.

    Notes
    -----
    Curless and Levoy 1996, with two changes. A pixel that shows no part of the object votes for free space as far as
    the photo shows. Behind a surface a photo votes with less weight the farther it is, see `_BEHIND`.
    """
    points = np.concatenate([surface_points(one, step=2) for one in maps])
    low, high = np.quantile(points, (_TAIL, 1 - _TAIL), axis=0)
    size = float(np.linalg.norm(high - low))
    if not size > 0:
        raise ObjectError("The photos show a single point of the object, so it has no surface.")
    pixel = float(np.median([np.median(one.depth[one.depth > 0]) / one.part.K[0, 0] for one in maps]))
    box = np.maximum(high - low, 0.02 * size)
    voxel = max(_VOXELS_PER_PIXEL * pixel, float((box.prod() / max_voxels) ** (1 / 3)))
    origin = low - _MARGIN * voxel
    shape = tuple(int(n) for n in np.ceil((high - low) / voxel).astype(int) + 2 * _MARGIN + 1)
    total, weight = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    for one in maps:
        if should_stop():
            raise Cancelled("Stopped while meshing; nothing was stored.")
        depth = np.where(one.spread > _MAX_SPREAD * size, np.float32(0), one.depth)
        matrix = one.part.viewmat[:3]
        start, step = matrix[:, :3] @ origin + matrix[:, 3], matrix[:, :3] * voxel
        lens = np.array([one.part.K[0, 0], one.part.K[1, 1], one.part.K[0, 2], one.part.K[1, 2]])
        band = _BAND * voxel

        def work(share: Share, arguments: tuple[object, ...] = (start, step, lens, depth, one.free, band)) -> None:
            _integrate(share, total, weight, *arguments, _BEHIND / _BAND)

        run_shared(work, None)
    total, weight = gaussian_filter(total, _SMOOTH), gaussian_filter(weight, _SMOOTH)
    seen = weight > _MIN_WEIGHT
    values = np.where(seen, total / np.maximum(weight, 1e-6), np.float32(1)).astype(np.float32)
    return Field(origin, voxel, values, seen)


@njit(**JIT)
def _integrate(share, total, weight, start, step, lens, depth, free, band, behind):  # type: ignore[no-untyped-def]
    """Add the votes of one photo to all voxels. `start` and the columns of `step` [3, 3] are camera coordinates."""
    nx, ny, nz = total.shape
    height, width = depth.shape
    fx, fy, cx, cy = lens
    while True:
        first, last = take_range(share, nx * ny, _COLUMNS_PER_RANGE)
        if first >= last:
            return
        for column in range(first, last):
            i, j = column // ny, column % ny
            x = start[0] + i * step[0, 0] + j * step[0, 1]
            y = start[1] + i * step[1, 0] + j * step[1, 1]
            z = start[2] + i * step[2, 0] + j * step[2, 1]
            for k in range(nz):
                pz = z + k * step[2, 2]
                if pz <= 1e-6:
                    continue
                u = fx * (x + k * step[0, 2]) / pz + cx
                v = fy * (y + k * step[1, 2]) / pz + cy
                if not (0 <= u < width and 0 <= v < height):
                    continue
                column_, row = int(u), int(v)
                d = depth[row, column_]
                if d == 0:
                    if pz < free[row, column_] - band:
                        total[i, j, k] += 1
                        weight[i, j, k] += 1
                    continue
                d = _interpolated(depth, u - 0.5, v - 0.5, d, band)
                distance = (d - pz) / band
                if distance >= -behind:
                    total[i, j, k] += min(distance, 1.0)
                    weight[i, j, k] += 1
                elif distance > -1:
                    w = (1 + distance) / (1 - behind)
                    total[i, j, k] += w * distance
                    weight[i, j, k] += w


@njit(**JIT)
def _interpolated(depth, u, v, nearest, band):  # type: ignore[no-untyped-def]
    """Return the depth between four pixels; that of the nearest one where they do not show one surface."""
    height, width = depth.shape
    column, row = int(np.floor(u)), int(np.floor(v))
    if column < 0 or row < 0 or column + 1 >= width or row + 1 >= height:
        return nearest
    a, b = depth[row, column], depth[row, column + 1]
    c, d = depth[row + 1, column], depth[row + 1, column + 1]
    least, most = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    if least == 0 or most - least > band:
        return nearest
    s, t = u - column, v - row
    return (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d)


def with_unseen_filled(field: Field, surface: Float64) -> Field:
    """Return the field with all that no photo saw inside of the hull of the seen surface counted as inside.

    Parameters
    ----------
    surface : array of shape [P, 3], float64
        Points of the seen surface, world units.

    Notes
    -----
    What no photo saw lies behind the seen surface, or in a hollow. Outside of the convex hull nothing is made up.
    """
    offsets, normals = _hull(surface)
    values = field.values.copy()
    unknown = np.flatnonzero(~field.seen.ravel())
    flat, band = values.reshape(-1), _BAND * field.voxel
    chunk = 1 << 18
    for first in range(0, len(unknown), chunk):
        rows = unknown[first : first + chunk]
        places = field.places(np.column_stack(np.unravel_index(rows, values.shape)).astype(np.float64))
        distance = (places.astype(np.float32) @ normals.T - offsets).max(axis=1)
        flat[rows] = np.clip(distance / band, -1, 1)
    return Field(field.origin, field.voxel, _closed(values), field.seen)


def _hull(surface: Float64) -> tuple[Float32, Float32]:
    """Return distances from the origin and normals of planes around points: those of their hull in many directions."""
    numbers = np.arange(_HULL_DIRECTIONS) + 0.5
    height, angle = 1 - 2 * numbers / _HULL_DIRECTIONS, np.pi * (1 + 5**0.5) * numbers
    radius = np.sqrt(1 - height**2)
    directions = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
    extreme = surface[np.unique((surface @ directions.T).argmax(axis=0))]
    try:
        planes = ConvexHull(extreme).equations
    except QhullError:
        # Flat: the slabs in these directions are a hull as well.
        planes = np.column_stack([directions, -(surface @ directions.T).max(axis=0)])
    return (-planes[:, 3]).astype(np.float32), planes[:, :3].astype(np.float32)


def _closed(values: Float32) -> Float32:
    """Return the field with its border outside, so that the surface ends nowhere."""
    for axis in range(3):
        border = np.moveaxis(values, axis, 0)
        border[0], border[-1] = np.maximum(border[0], 0.5), np.maximum(border[-1], 0.5)
    return values
