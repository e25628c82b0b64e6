# SPDX-License-Identifier: GPL-3.0-or-later
"""Upright boxes that are turned about Z: intersection, distance and what hides what."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, hypot, radians, sin

import numpy as np

from .things import Thing


@dataclass(frozen=True)
class Box:
    """A box: middle of its footprint, heights of bottom and top, half sizes, rotation about Z in degrees."""

    x: float
    y: float
    bottom: float
    top: float
    half_x: float
    half_y: float
    turn: float = 0.0

    @cached_property
    def axes(self) -> np.ndarray:
        """Its horizontal axes as rows [2, 2]."""
        c, s = cos(radians(self.turn)), sin(radians(self.turn))
        return np.array([[c, s], [-s, c]])

    @cached_property
    def corners(self) -> np.ndarray:
        """The corners of its footprint [4, 2]."""
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return np.array([self.x, self.y]) + (signs * [self.half_x, self.half_y]) @ self.axes

    def grown(self, gap: float, height: float = 0.0) -> Box:
        """Return the box with its sides moved outwards by `gap`, bottom and top by `height`."""
        return replace(
            self,
            half_x=self.half_x + gap,
            half_y=self.half_y + gap,
            bottom=self.bottom - height,
            top=self.top + height,
        )

    def intersects(self, other: Box) -> bool:
        """Return whether the boxes share a volume."""
        if self.top <= other.bottom or other.top <= self.bottom:
            return False
        radii = hypot(self.half_x, self.half_y) + hypot(other.half_x, other.half_y)
        if hypot(self.x - other.x, self.y - other.y) >= radii:
            return False
        axes = np.concatenate([self.axes, other.axes])
        a, b = self.corners @ axes.T, other.corners @ axes.T
        return bool(np.all((a.max(axis=0) > b.min(axis=0)) & (b.max(axis=0) > a.min(axis=0))))

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Return which points [N, 3] are inside [N]."""
        local = (points[:, :2] - [self.x, self.y]) @ self.axes.T
        flat = (np.abs(local) <= [self.half_x, self.half_y]).all(axis=1)
        return flat & (points[:, 2] >= self.bottom) & (points[:, 2] <= self.top)


def box_of(thing: Thing, where: tuple[float, float, float], turn: float) -> Box:
    """Return the box of a thing at a place; see `build.Workshop.build`."""
    return placed_box(np.array(thing.low), np.array(thing.high), where, turn)


def placed_box(low: np.ndarray, high: np.ndarray, where: tuple[float, float, float], turn: float) -> Box:
    """Return the box between two corners in coordinates of a thing that is placed."""
    middle, half = (low + high) / 2, (high - low) / 2
    c, s = cos(radians(turn)), sin(radians(turn))
    return Box(
        where[0] + c * float(middle[0]) - s * float(middle[1]),
        where[1] + s * float(middle[0]) + c * float(middle[1]),
        where[2] + float(low[2]),
        where[2] + float(high[2]),
        float(half[0]),
        float(half[1]),
        turn,
    )


def hidden(eye: np.ndarray, points: np.ndarray, owners: np.ndarray, boxes: list[Box], of: np.ndarray) -> np.ndarray:
    """Return which points are hidden from an eye by a box of another thing.

    Parameters
    ----------
    eye, points
        Positions [3] and [N, 3].
    owners, of
        Number of the thing of each point [N] and of each box [B]; a box hides no points of its own thing.
    """
    axes = np.array([box.axes for box in boxes])
    middles = np.array([[box.x, box.y, (box.bottom + box.top) / 2] for box in boxes])
    half = np.array([[box.half_x, box.half_y, (box.top - box.bottom) / 2] for box in boxes])
    # In coordinates of each box: where the ray begins [B, 3], and its way to each point [B, N] along each axis.
    begin = eye - middles
    begin[:, :2] = np.einsum("bij,bj->bi", axes, begin[:, :2])
    rays = (points - eye).T
    ways = [axes[:, k, 0:1] * rays[0] + axes[:, k, 1:2] * rays[1] for k in (0, 1)]
    ways.append(np.broadcast_to(rays[2], ways[0].shape))
    enter, leave = np.full(ways[0].shape, -np.inf), np.full(ways[0].shape, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k, way in enumerate(ways):
            first = (-half[:, k : k + 1] - begin[:, k : k + 1]) / way
            second = (half[:, k : k + 1] - begin[:, k : k + 1]) / way
            enter, leave = np.fmax(enter, np.fmin(first, second)), np.fmin(leave, np.fmax(first, second))
    blocked = (enter < leave) & (leave > 0) & (enter < 0.995) & (owners != of[:, None])
    return blocked.any(axis=0)
