# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces as NumPy arrays, without Blender: turned profiles, swept tubes, boxes, slabs, lofts. Units: metres."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import cos, pi, radians, sin

import numpy as np

Point2 = tuple[float, float]
Point3 = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Shape:
    """A surface.

    Attributes
    ----------
    vertices
        Positions [V, 3].
    quads
        Indices of vertices [F, 4].
    uvs
        Texture coordinates [F, 4, 2] of the corners of `quads`, or None.
    caps
        Further faces with any number of corners.
    cap_uvs
        One texture coordinate per cap, of all its corners.
    crease
        Edges with an angle above this many degrees are sharp.
    """

    vertices: np.ndarray
    quads: np.ndarray
    uvs: np.ndarray | None = None
    caps: tuple[tuple[int, ...], ...] = ()
    cap_uvs: tuple[Point2, ...] = ()
    crease: float = 40.0

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Shape:
        """Return the shape shifted by (x, y, z)."""
        return replace(self, vertices=self.vertices + np.array([x, y, z]))

    def turned(self, axis: str, degrees: float) -> Shape:
        """Return the shape rotated about the axis "x", "y" or "z" through the origin."""
        return replace(self, vertices=self.vertices @ rotation(axis, degrees).T)

    def scaled(self, x: float, y: float, z: float) -> Shape:
        """Return the shape scaled along the axes by positive factors."""
        return replace(self, vertices=self.vertices * np.array([x, y, z]))

    def bent(self, move: Callable[[np.ndarray], np.ndarray]) -> Shape:
        """Return the shape with its vertices [V, 3] mapped by a function."""
        return replace(self, vertices=move(self.vertices))


def rotation(axis: str, degrees: float) -> np.ndarray:
    """Return the matrix [3, 3] of a right-handed rotation about the axis "x", "y" or "z"."""
    c, s = cos(radians(degrees)), sin(radians(degrees))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return matrix


def smooth(points: Sequence[Sequence[float]], steps: int = 8) -> np.ndarray:
    """Interpolate control points with a Catmull-Rom curve that passes through all of them."""
    controls = np.asarray(points, dtype=float)
    padded = np.vstack([2 * controls[0] - controls[1], controls, 2 * controls[-1] - controls[-2]])
    t = (np.arange(steps) / steps)[:, None]
    curve = []
    for before, start, end, after in zip(padded, padded[1:], padded[2:], padded[3:], strict=False):
        curve.append(
            0.5
            * (
                2 * start
                + (end - before) * t
                + (2 * before - 5 * start + 4 * end - after) * t**2
                + (3 * start - before - 3 * end + after) * t**3
            )
        )
    return np.vstack([*curve, controls[-1:]])


def lathe(profile: Sequence[Sequence[float]], segments: int = 80, planar: bool = False) -> Shape:
    """Return a solid of revolution of a profile of (radius, height) points around Z.

    Parameters
    ----------
    planar
        Whether the texture is projected from above (for discs) instead of around the side with v along the height.
    """
    profile = np.asarray(profile, dtype=float)
    angles = np.linspace(0, 2 * pi, segments, endpoint=False)
    radius, height = profile[:, 0:1], profile[:, 1:2]
    rings = np.stack([radius * np.cos(angles), radius * np.sin(angles), height + 0 * angles], axis=-1)
    vertices = rings.reshape(-1, 3)
    quads = _ring_quads(len(profile), segments)
    if planar:
        uvs = vertices[quads][..., :2] / (2 * profile[:, 0].max()) + 0.5
    else:
        v = (profile[:, 1] - profile[:, 1].min()) / max(np.ptp(profile[:, 1]), 1e-9)
        uvs = _ring_uvs(np.arange(segments + 1) / segments, v)
    return Shape(vertices, quads, uvs)


def tube(
    path: Sequence[Sequence[float]], radii: float | Sequence[float], sides: int = 16, flatten: float = 1.0
) -> Shape:
    """Sweep a circle, or an ellipse with its binormal axis scaled by `flatten`, along a path and close the ends."""
    path = np.asarray(path, dtype=float)
    radii = np.broadcast_to(np.asarray(radii, dtype=float), len(path))
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    normal = np.cross(tangents[0], (0.0, 0.0, 1.0) if abs(tangents[0][2]) < 0.9 else (1.0, 0.0, 0.0))
    angles = np.linspace(0, 2 * pi, sides, endpoint=False)
    cosines, sines = np.array([[cos(a)] for a in angles]), np.array([[sin(a)] for a in angles])
    rings = []
    for centre, radius, tangent in zip(path, radii, tangents, strict=True):
        # The normal follows from the previous one, so that the tube does not twist where the path bends.
        normal = normal - tangent * normal.dot(tangent)
        normal /= np.linalg.norm(normal)
        binormal = _cross(tangent, normal) * flatten
        rings.append(centre + radius * (cosines * normal + sines * binormal))
    return loft(rings)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    # For single vectors this is much faster than np.cross, with the same result.
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def loft(rings: Sequence[Sequence[Sequence[float]]]) -> Shape:
    """Return the closed surface through rings of equally many points [R, S, 3], with flat ends."""
    points = np.asarray(rings, dtype=float)
    count, sides = points.shape[:2]
    last = (count - 1) * sides
    return Shape(
        points.reshape(-1, 3),
        _ring_quads(count, sides),
        _ring_uvs(np.arange(sides + 1) / sides, np.arange(count) / count),
        caps=(tuple(range(sides))[::-1], tuple(range(last, last + sides))),
        cap_uvs=((0.0, 0.0), (1.0, 1.0)),
    )


def quad(corners: Sequence[Point3], repeat: Point2 = (1.0, 1.0)) -> Shape:
    """Return a textured rectangle; the corners start at the texture's lower left, counter-clockwise."""
    u, v = repeat
    uvs = np.array([[(0, 0), (u, 0), (u, v), (0, v)]], dtype=float)
    return Shape(np.array(corners), np.array([(0, 1, 2, 3)]), uvs)


def ring(radius: float, thickness: float, segments: int = 48, sides: int = 10) -> Shape:
    """Return a torus around Z; `thickness` is the radius of its tube."""
    around = np.linspace(0, 2 * pi, segments, endpoint=False)[:, None]
    along = np.linspace(0, 2 * pi, sides, endpoint=False)[None, :]
    reach = radius + thickness * np.cos(along)
    points = np.stack([reach * np.cos(around), reach * np.sin(around), thickness * np.sin(along) + 0 * around], axis=-1)
    i, j = np.meshgrid(np.arange(segments), np.arange(sides), indexing="ij")
    i2, j2 = (i + 1) % segments, (j + 1) % sides
    quads = np.stack([i * sides + j, i2 * sides + j, i2 * sides + j2, i * sides + j2], axis=-1).reshape(-1, 4)
    corner = np.stack(
        [np.stack([a / segments, b / sides], -1) for a, b in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))], 2
    )
    return Shape(points.reshape(-1, 3), quads, corner.reshape(-1, 4, 2))


def ball(x: float, y: float, z: float, segments: int = 40) -> Shape:
    """Return an ellipsoid around the origin with these radii; v of its texture is the latitude."""
    turns = np.linspace(-pi / 2, pi / 2, segments // 2 + 1)
    profile = np.stack([np.maximum(np.cos(turns), 1e-4), np.sin(turns)], axis=1)
    made = lathe(profile, segments)
    uvs = _ring_uvs(np.arange(segments + 1) / segments, turns / pi + 0.5)
    return replace(made, uvs=uvs).scaled(x, y, z)


def box(x: float, y: float, z: float, chamfer: float = 0.006) -> Shape:
    """Return a box of this size on z = 0 with chamfered edges; each side shows a whole texture."""
    half = np.array([x, y, z]) / 2
    cut = min(chamfer, 0.45 * 2 * float(half.min()))
    # One vertex per corner and axis: it lies on the side of that axis, `cut` away from its edges.
    index: dict[tuple[int, int, int, int], int] = {}
    vertices = []
    for sx in (-1, 1):
        for sy in (-1, 1):
            for sz in (-1, 1):
                for axis in range(3):
                    at = half - cut
                    at[axis] = half[axis]
                    index[sx, sy, sz, axis] = len(vertices)
                    vertices.append(np.array([sx, sy, sz]) * at)
    quads, uvs, caps = [], [], []
    whole, none = [(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 0)] * 4
    for axis in range(3):
        # The first of the two other axes runs to the right, seen from outside, on the side of positive sign.
        right, up = {0: (1, 2), 1: (0, 2), 2: (0, 1)}[axis]
        for sign in (-1, 1):
            flip = sign if axis != 1 else -sign
            corners = []
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                signs = [0, 0, 0]
                signs[axis], signs[right], signs[up] = sign, a * flip, b
                corners.append(index[signs[0], signs[1], signs[2], axis])
            quads.append(corners)
            uvs.append(whole)
    if cut > 0:
        for axis in range(3):
            first, second = [k for k in range(3) if k != axis]
            for a in (-1, 1):
                for b in (-1, 1):
                    signs = [0, 0, 0]
                    signs[first], signs[second] = a, b
                    low, high = list(signs), list(signs)
                    low[axis], high[axis] = -1, 1
                    edge = [(*low, first), (*low, second), (*high, second), (*high, first)]
                    quads.append([index[k] for k in edge])
                    uvs.append(none)
        caps = [
            tuple(index[sx, sy, sz, axis] for axis in range(3)) for sx in (-1, 1) for sy in (-1, 1) for sz in (-1, 1)
        ]
    return Shape(
        np.array(vertices) + np.array([0, 0, z / 2]),
        np.array(quads),
        np.array(uvs, dtype=float),
        tuple(caps),
        ((0.0, 0.0),) * len(caps),
        crease=30.0,
    )


def slab(outline: Sequence[Point2], deep: float, chamfer: float = 0.0) -> Shape:
    """Return a plate with an outline of (x, z) points in the plane y = 0, `deep` towards -Y.

    With a chamfer, the front is smaller by it. The texture is projected on the front.
    """
    shape = np.asarray(outline, dtype=float)
    count = len(shape)
    low, size = shape.min(axis=0), np.maximum(np.ptp(shape, axis=0), 1e-9)
    middle = low + size / 2
    inner = middle + (shape - middle) * (1 - 2 * chamfer / size)
    rows = [(shape, 0.0), (shape, -deep + chamfer)] + ([(inner, -deep)] if chamfer else [])
    vertices = np.vstack([np.insert(row, 1, y, axis=1) for row, y in rows])
    # A fan from the middle triangulates the front, because its texture needs coordinates of its own.
    front = (len(rows) - 1) * count
    vertices = np.vstack([vertices, [middle[0], -deep, middle[1]]])
    quads = _ring_quads(len(rows), count)
    uvs = ((vertices[quads][..., [0, 2]]) - low) / size
    k = np.arange(count)
    fan = np.stack([front + k, front + (k + 1) % count, np.full(count, len(vertices) - 1)], axis=1)
    fan = np.concatenate([fan, fan[:, 2:]], axis=1)  # degenerate quads, which are made triangles where they are used
    return Shape(
        vertices,
        np.concatenate([quads, fan]),
        np.concatenate([uvs, (vertices[fan][..., [0, 2]] - low) / size]),
        (tuple(range(count))[::-1],),
        ((0.0, 0.0),),
        crease=30.0,
    )


def field(
    depth: Callable[[np.ndarray, np.ndarray], np.ndarray],
    inside: Callable[[np.ndarray, np.ndarray], np.ndarray],
    half_width: float,
    half_height: float,
    cells: int = 90,
) -> Shape:
    """Return a height field over the plane y = 0 that faces -Y, restricted to where `inside` is true.

    Parameters
    ----------
    depth, inside
        Functions of x and z, both in -1..1; depth is in metres towards the viewer.
    """
    axis = np.linspace(-1, 1, cells + 1)
    x, z = np.meshgrid(axis, axis)
    vertices = np.stack([x * half_width, -depth(x, z), z * half_height], axis=-1).reshape(-1, 3)
    middle = (axis[1:] + axis[:-1]) / 2
    row, column = np.nonzero(inside(*np.meshgrid(middle, middle)))
    a = row * (cells + 1) + column
    quads = np.stack([a, a + 1, a + cells + 2, a + cells + 1], axis=1)
    corners = [np.stack([column + i, row + j], axis=-1) / cells for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    used, renumbered = np.unique(quads, return_inverse=True)
    return Shape(vertices[used], renumbered.reshape(-1, 4), np.stack(corners, axis=1), crease=60.0)


def _ring_quads(rings: int, sides: int) -> np.ndarray:
    i, j = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    k = (j + 1) % sides
    return np.stack([i * sides + j, i * sides + k, (i + 1) * sides + k, (i + 1) * sides + j], axis=-1).reshape(-1, 4)


def _ring_uvs(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    rings, sides = len(v), len(u) - 1
    i, j = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    ends = ((j, i), (j + 1, i), (j + 1, i + 1), (j, i + 1))
    return np.stack([np.stack([u[a], v[b]], axis=-1) for a, b in ends], axis=2).reshape(-1, 4, 2)
