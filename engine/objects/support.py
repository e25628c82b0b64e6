"""Support: the horizontal surface that an object stands on tells where its foot ends; see docs/objects.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from ..core.arrays import Float32, Float64, Int64, Mask
from ..scene import Gaussians, rotations_from_quats

_UPRIGHT = 0.85  # chosen on room_1, room_5
"""Least cosine between the shortest axis of a horizontal Gaussian and the vertical: up to 32 degrees."""

_RADIUS = 1.5
"""Standard deviations up to which a Gaussian is a surface."""

_TURNS = np.arange(8) * np.pi / 4
_SPOTS = np.vstack([
    np.zeros((1, 2)),
    0.6 * np.stack([np.cos(_TURNS), np.sin(_TURNS)], axis=1),
    1.3 * np.stack([np.cos(_TURNS + np.pi / 8), np.sin(_TURNS + np.pi / 8)], axis=1),
])  # fmt: skip
"""Spots of a Gaussian, in standard deviations along its two longer axes: one may be larger than what stands on it."""

_STEPS = 40  # chosen on room_1, room_5
"""Steps in the height of a set. A surface is three of them thick."""

_SEARCHED = 1.0  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Heights of a set below it within which the surface that carries it is looked for."""

_CELLS, _PLAN_RADII = 120, 4.4
"""Cells along a side of the ground plan, and this side in radii of the set, which hold 95 % of it."""

_RADIUS_SHARE = 0.95
_RING = (0.05, 0.35)  # chosen on room_1, room_5
"""Distances from the ground plan of what stands on a surface, in its radii, between which the surface is looked for."""

_LEAST_STANDING = 0.5  # chosen on room_1, room_5, room_7
"""Least share of the set that stands on the surface: less stands on the shoulder of a bottle."""

_LEAST_COVER = 0.1  # chosen on room_1, room_3, room_5, room_6, room_8
"""Least share of the ring that a surface covers: the foot of a chess piece covers less around its body."""

_CLEAR_COVER = 0.25  # chosen on room_1, room_3, room_5, room_7, museum_room
"""Share of the ring that a surface covers from which on a missing foot is added down to it."""


@dataclass(frozen=True)
class Surfaces:
    """Spots of the horizontal Gaussians of a scene.

    Attributes
    ----------
    spots : array of shape [S, 3], float64
        World units; Z is up.
    areas : array of shape [S], float64
        That each spot stands for, by the opacity of its Gaussian.
    """

    spots: Float64
    areas: Float64


class _Support(NamedTuple):
    """A surface that a set stands on: its height, and the share of the ring that it covers."""

    height: float
    cover: float


class _Outline(NamedTuple):
    """What of a set lies above a height: its share, middle [2], radius, and the distance of each cell of the plan."""

    share: float
    middle: Float64
    radius: float
    distance: Float64


def horizontal_surfaces(gaussians: Gaussians) -> Surfaces:
    """Return the horizontal surfaces of a scene."""
    axes, scales = rotations_from_quats(gaussians.quats), gaussians.scales.astype(np.float64)
    order, each = np.argsort(scales, axis=1), np.arange(len(scales))
    level = np.flatnonzero(np.abs(axes[each, 2, order[:, 0]]) > _UPRIGHT)
    middle, long = (scales[level, order[level, rank], None] for rank in (1, 2))
    second, third = (axes[level, :, order[level, rank]] for rank in (1, 2))
    spots = gaussians.means[level, None] + np.einsum("sk,knd->nsd", _SPOTS, np.stack([second * middle, third * long]))
    areas = gaussians.opacities[level] * np.pi * _RADIUS**2 * (middle * long).ravel() / len(_SPOTS)
    return Surfaces(spots.reshape(-1, 3), np.repeat(areas, len(_SPOTS)))


def standing(members: Mask, surfaces: Surfaces, means: Float32, likely: Mask | None = None) -> Mask:
    """Return a set with the foot that it stands on, and without what carries it.

    Where a horizontal surface is seen around the set, what lies below it is left out, and so is what lies in it beside
    the ground plan of what stands on it. What lies between the surface and the set, in its ground plan, is its foot:
    all that is below the whole set, and what is `likely` below the members above it. A set without such a surface,
    which may hang on a wall, stays as it is.

    Parameters
    ----------
    members : array of shape [N], bool
    means : array of shape [N, 3], float32
        Positions of the Gaussians.
    likely : array of shape [N], bool, or None
        Gaussians that photos show inside of the outlines of the set; none without it.

    Returns
    -------
    array of shape [N], bool
    """
    if not members.any():
        return members
    plan = _Plan(members, surfaces, means)
    support = plan.support()
    return members if support is None else plan.standing(support, likely)


class _Plan:
    """The ground plan of a set, in square cells around its middle; arguments as of `standing`."""

    def __init__(self, members: Mask, surfaces: Surfaces, means: Float32) -> None:
        self.members, self.means, self.heights = members, means, means[:, 2]
        own = means[members].astype(np.float64)
        self.bottom, top = own[:, 2].min(), own[:, 2].max()
        self.middle = np.median(own[:, :2], axis=0)
        radius = float(np.quantile(np.hypot(*(own[:, :2] - self.middle).T), _RADIUS_SHARE))
        self.tall = float(max(top - self.bottom, radius / 2)) or 1.0
        self.step = self.tall / _STEPS
        self.cell = _PLAN_RADII * radius / _CELLS or self.step
        beside, z = np.abs(surfaces.spots[:, :2] - self.middle), surfaces.spots[:, 2]
        self.lowest = self.bottom - _SEARCHED * self.tall
        near = (beside < _PLAN_RADII / 2 * radius).all(axis=1) & (z > self.lowest - 3 * self.step) & (z < top)
        self.spots, self.areas = surfaces.spots[near], surfaces.areas[near]
        self.cell_of_spot, self.cell_of = self._cells(self.spots), self._cells(means)

    def _cells(self, points: Float64 | Float32) -> Int64:
        """Return the number of the cell of each point; those beside the plan are in its outermost cells."""
        cells = np.floor((points[:, :2] - self.middle) / self.cell + _CELLS / 2)
        return np.asarray(np.clip(cells, 0, _CELLS - 1) @ [_CELLS, 1], np.int64)

    def _above(self, height: float) -> _Outline | None:
        """Return the outline of what of the set lies above a height; None where that is less than needed."""
        above = np.flatnonzero(self.members & (self.heights > height))
        share = len(above) / int(self.members.sum())
        if share < _LEAST_STANDING:
            return None
        positions = self.means[above, :2].astype(np.float64)
        middle = np.median(positions, axis=0)
        distances = np.hypot(*(positions - middle).T)
        radius = float(np.quantile(distances, _RADIUS_SHARE))
        free = np.ones(_CELLS * _CELLS, np.uint8)
        free[self.cell_of[above[distances <= radius]]] = 0
        distance = cv2.distanceTransform(free.reshape(_CELLS, _CELLS), cv2.DIST_L2, 5).astype(np.float64)
        return _Outline(share, middle, radius, distance.ravel() * self.cell)

    def support(self) -> _Support | None:
        """Return the surface that the set stands on: of all heights, where it covers most, times what stands on it.

        It is looked for from `_SEARCHED` heights of the set below it upwards.
        """
        found: list[tuple[float, _Support]] = []
        for height in np.arange(self.lowest, self.bottom + self.tall, self.step):
            outline = self._above(height + self.step)
            if outline is None:
                break
            surface = self._surface(float(height), outline)
            if surface.cover >= _LEAST_COVER:
                found.append((surface.cover * outline.share, surface))
        return max(found)[1] if found else None

    def _surface(self, height: float, outline: _Outline) -> _Support:
        """Return the surface around an outline at a height, which may cover nothing."""
        low, high = (one * outline.radius + self.cell for one in _RING)
        ring = (outline.distance > low) & (outline.distance < high)
        inside, apart = ring[self.cell_of_spot], np.abs(self.spots[:, 2] - height)
        at = inside & (apart < 1.5 * self.step)
        areas = np.bincount(self.cell_of_spot[at], self.areas[at], _CELLS * _CELLS) / self.cell**2
        if not at.any():
            return _Support(height, 0.0)
        around = inside & (apart < 3 * self.step)
        exact = float(np.average(self.spots[around, 2], weights=self.areas[around]))
        return _Support(exact, float(np.minimum(areas[ring], 1).mean()))

    def standing(self, support: _Support, likely: Mask | None) -> Mask:
        """Return what of the set stands on a surface, with its foot."""
        height, z = support.height, self.heights
        outline = self._above(height + 2 * self.step)
        if outline is None:
            return self.members
        inside = outline.distance[self.cell_of] <= _RING[0] * outline.radius + self.cell
        inside &= np.hypot(*(self.means[:, :2] - outline.middle).T) < 2 * outline.radius
        clear = z > height + self.step
        found = self.members & (z > height - self.step) & (clear | inside)
        if support.cover >= _CLEAR_COVER:
            below = z < self.bottom
            if likely is not None:
                below |= likely & (z < self._lowest_above(height + self.step, outline)[self.cell_of])
            found |= clear & inside & below
        return np.asarray(found)

    def _lowest_above(self, height: float, outline: _Outline) -> Float32:
        """Return the height of the lowest member above a height in each cell, or of the highest such one near it.

        Minus infinity in cells without members near them.
        """
        above = np.flatnonzero(self.members & (self.heights > height))
        lowest = np.full(_CELLS * _CELLS, np.inf, np.float32)
        np.minimum.at(lowest, self.cell_of[above], self.heights[above])
        lowest[np.isinf(lowest)] = -np.inf
        side = 2 * max(1, round(_RING[0] * outline.radius / self.cell)) + 1
        return cv2.dilate(lowest.reshape(_CELLS, _CELLS), np.ones((side, side))).ravel()
