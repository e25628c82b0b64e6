"""The surface where a field of signed distances is 0, by marching tetrahedra: closed and without doubtful cases."""

from __future__ import annotations

import itertools

import numpy as np

from ..core.arrays import Float64, Int32, Mask
from .fusion import Field

_CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))
"""The corners of a cell, [8, 3]; the number of a corner is 4x + 2y + z."""

_TETRAHEDRA = np.array([
    [0, *np.cumsum([4 >> axis for axis in order])] for order in itertools.permutations(range(3))
])  # fmt: skip
"""Six tetrahedra of a cell (Freudenthal): from corner 0 to corner 7 along the axes in each order. Neighbouring cells
divide their common side in the same way."""

_MIN_ABSOLUTE = 1e-4
"""Smallest value of a corner, so that no two places of the surface coincide."""

_NEAR = 0.25  # chosen on room_1
"""Distance in bands, here one voxel, within which a single measured voxel shows the surface beside it: where photos
disagree, their votes behind a surface may have faded before they outweigh those before it."""


def extract_surface(field: Field) -> tuple[Float64, Int32, Mask]:
    """Return vertices, triangles, and which vertices lie where photos measured.

    Returns
    -------
    vertices : array of shape [V, 3], float64
        World units.
    faces : array of shape [F, 3], int32
        Counterclockwise seen from outside.
    seen : array of shape [V], bool

    References
    ----------
    Doi and Koide 1991; Freudenthal 1942 for the tetrahedra.
    """
    values = np.where(np.abs(field.values) < _MIN_ABSOLUTE, np.float32(_MIN_ABSOLUTE), field.values)
    shape = np.array(values.shape)
    inside = values < 0
    counts = sum(
        inside[tuple(slice(c, n - 1 + c) for c, n in zip(corner, shape, strict=True))].astype(np.int8)
        for corner in _CORNERS
    )
    cells = np.argwhere((counts > 0) & (counts < 8))
    strides = np.array([shape[1] * shape[2], shape[2], 1], np.int64)
    corner_ids = (cells @ strides)[:, None] + _CORNERS @ strides  # [C, 8]
    flat = values.reshape(-1)
    ends: list[np.ndarray] = []
    for tetrahedron in _TETRAHEDRA:
        ids = corner_ids[:, tetrahedron]
        ends += _triangles_of(ids, flat[ids] < 0, _is_odd(tetrahedron))
    joined = np.concatenate(ends) if ends else np.zeros((0, 3, 2), np.int64)
    pairs = np.sort(joined.reshape(-1, 2), axis=1)
    keys, numbers = np.unique(pairs[:, 0] * len(flat) + pairs[:, 1], return_inverse=True)
    a, b = keys // max(len(flat), 1), keys % max(len(flat), 1)
    share = (flat[a] / (flat[a] - flat[b])).astype(np.float64)[:, None]
    places = [np.column_stack(np.unravel_index(one, values.shape)).astype(np.float64) for one in (a, b)]
    vertices = field.places(places[0] * (1 - share) + places[1] * share)
    known = field.seen.reshape(-1)
    near = np.abs(np.where(known[a], flat[a], flat[b])) < _NEAR
    seen = (known[a] & known[b]) | (near & (known[a] | known[b]))
    return vertices, numbers.reshape(-1, 3).astype(np.int32), seen


def _is_odd(tetrahedron: np.ndarray) -> bool:
    """Return whether the four corners of a tetrahedron turn left."""
    first, *others = _CORNERS[tetrahedron]
    return bool(np.linalg.det(np.array(others) - first) < 0)


def _triangles_of(ids: np.ndarray, inside: np.ndarray, is_odd: bool) -> list[np.ndarray]:
    """Return the triangles of one tetrahedron of each cell, as pairs of voxels on whose edges their vertices lie.

    Each is an array of shape [T, 3, 2]. `ids` and `inside` have the shape [C, 4].
    """
    found = []
    code = inside @ np.array([1, 2, 4, 8])
    for case in range(1, 15):
        rows = ids[code == case]
        if not len(rows):
            continue
        within = [k for k in range(4) if case >> k & 1]
        outside = [k for k in range(4) if not case >> k & 1]
        if len(within) == 2:
            (p, q), (r, s) = within, outside
            corners = [(p, r), (p, s), (q, s), (q, r)]
            polygons = [(0, 1, 2), (0, 2, 3)]
        else:
            alone, others = (within[0], outside) if len(within) == 1 else (outside[0], within)
            corners, polygons = [(alone, other) for other in others], [(0, 1, 2)]
        if _turns_inward(corners, within, outside) != is_odd:
            polygons = [polygon[::-1] for polygon in polygons]
        for polygon in polygons:
            found.append(np.stack([rows[:, list(corners[k])] for k in polygon], axis=1))
    return found


_UNIT = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)


def _turns_inward(corners: list[tuple[int, int]], within: list[int], outside: list[int]) -> bool:
    """Return whether the first triangle faces the corners inside, in a tetrahedron whose corners turn right."""
    a, b, c = (_UNIT[list(corners[k])].mean(axis=0) for k in range(3))
    outward = _UNIT[outside].mean(axis=0) - _UNIT[within].mean(axis=0)
    return bool(np.dot(np.cross(b - a, c - a), outward) < 0)
