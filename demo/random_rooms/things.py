# SPDX-License-Identifier: GPL-3.0-or-later
"""Things made of shapes with materials, with their bounding box; and helpers of the builders. Units: metres."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
from studio.shapes import Shape, ring, smooth, tube

from .stuffs import Stuff


@dataclass(frozen=True, eq=False)
class Part:
    """A shape and its material."""

    shape: Shape
    stuff: Stuff


@dataclass(frozen=True)
class Cavity:
    """Room inside a thing for another one, around its vertical axis: half sizes, and heights of floor and rim."""

    half_x: float
    half_y: float
    floor: float
    rim: float


@dataclass(frozen=True, eq=False)
class Thing:
    """An exhibit or a piece of furniture, in coordinates of its own.

    Attributes
    ----------
    parts
        What it is made of. It stands on z = 0 around the Z axis, or hangs on a wall behind y = 0 around the Y axis.
    low, high
        Corners of its bounding box.
    cavity
        Room inside for another thing, or None.
    """

    parts: tuple[Part, ...]
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    cavity: Cavity | None = None

    @property
    def size(self) -> np.ndarray:
        """Size of the bounding box [3]."""
        return np.array(self.high) - np.array(self.low)

    @property
    def base(self) -> np.ndarray:
        """Width and depth [2] around the axis of what is within 5 cm of the ground."""
        vertices = np.concatenate([part.shape.vertices for part in self.parts])
        return 2 * np.abs(vertices[vertices[:, 2] < self.low[2] + 0.05, :2]).max(axis=0)


def standing(parts: Iterable[Part], cavity: Cavity | None = None) -> Thing:
    """Return a thing that stands on z = 0 with its bounding box around the Z axis.

    The shapes of a thing with a cavity must be around the axis already.
    """
    return _placed(list(parts), (0.5, 0.5, 0.0), cavity)


def hanging(parts: Iterable[Part]) -> Thing:
    """Return a thing that hangs on the wall y = 0, seen from -Y, with its bounding box around the Y axis."""
    return _placed(list(parts), (0.5, 1.0, 0.5), None)


def _placed(parts: list[Part], origin: tuple[float, float, float], cavity: Cavity | None) -> Thing:
    low = np.min([part.shape.vertices.min(axis=0) for part in parts], axis=0)
    high = np.max([part.shape.vertices.max(axis=0) for part in parts], axis=0)
    shift = -(low + np.array(origin) * (high - low))
    if cavity is not None:
        shift[:2] = 0.0
    moved = tuple(Part(part.shape.moved(*shift.tolist()), part.stuff) for part in parts)
    return Thing(moved, tuple((low + shift).tolist()), tuple((high + shift).tolist()), cavity)


def limb(points: Sequence[Sequence[float]], radii: Sequence[float], sides: int = 14, flatten: float = 1.0) -> Shape:
    """Return a smooth tube through points with a radius at each."""
    path = smooth(points, 6)
    at = np.linspace(0, 1, len(path))
    return tube(path, np.interp(at, np.linspace(0, 1, len(radii)), radii), sides, flatten)


def rod(start: Sequence[float], end: Sequence[float], radius: float, sides: int = 8) -> Shape:
    """Return a straight round rod between two points."""
    a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    return tube([a, (a + b) / 2, b], radius, sides)


def hoop(radius: float, height: float, thickness: float) -> Shape:
    """Return a ring around the Z axis at a height."""
    return ring(radius, thickness).moved(z=height)


def around(count: int, start: float = 0.0) -> list[float]:
    """Return angles in radians that divide a circle."""
    return [start + 2 * pi * k / count for k in range(count)]


def polar(radius: float, angle: float, z: float) -> tuple[float, float, float]:
    """Return the point at a radius and an angle in radians around the Z axis."""
    return (radius * cos(angle), radius * sin(angle), z)


def parts_of(stuff: Stuff, *shapes: Shape) -> list[Part]:
    """Return parts of one material."""
    return [Part(shape, stuff) for shape in shapes]
