"""What of an extracted surface is kept: no floaters, and of the parts that no photo saw only small ones, or all."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..core.arrays import Float32, Float64, Int32, Int64, Mask
from ..core.errors import ObjectError

_MIN_PART = 0.02
"""Area of a separate part, relative to that of the largest one, below which it is a floater."""

_NARROW_HOLE = 0.05  # chosen on room_1
"""Largest distance from the seen surface in a hole that is closed without being asked for, as a share of the object's
diagonal. A slit is closed however long it is."""

_SEPARATION, _SEPARATIONS = 0.05, 8
"""Share of the way to their neighbours by which vertices at the same place are moved, and how often at most."""


def areas_of(vertices: Float64, faces: Int32) -> Float64:
    """Return the area of each triangle, [F]."""
    a, b, c = (vertices[faces[:, k]].astype(np.float64) for k in range(3))
    areas: Float64 = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return areas


def main_parts(vertices: Float64, faces: Int32, seen: Mask) -> Mask:
    """Return which triangles belong to parts that are no floaters, [F].

    Parameters
    ----------
    vertices : array of shape [V, 3], float64
    faces : array of shape [F, 3], int32
    seen : array of shape [F], bool
        Only the seen area of a part counts: one that no photo saw is a floater, such as the wall of a void.

    Raises
    ------
    ObjectError
        When no triangle was seen.
    """
    if not seen.any():
        raise ObjectError(
            "The photos show no surface of this object: it is too transparent, or too few photos show it. Export its "
            "Gaussians instead."
        )
    parts = _parts(faces, len(vertices))
    area = np.bincount(parts, areas_of(vertices, faces) * seen)
    return (area >= _MIN_PART * area.max())[parts]


def kept_faces(vertices: Float64, faces: Int32, seen: Mask, *, watertight: bool) -> Mask:
    """Return which triangles are kept, [F]: the seen ones, and those that close narrow holes, or all holes.

    Parameters
    ----------
    vertices, faces, seen
        As of `main_parts`, of a closed surface.
    watertight : bool
        Whether all holes are closed.
    """
    kept = main_parts(vertices, faces, seen)
    if watertight:
        return kept
    filling = np.flatnonzero(kept & ~seen)
    patches = _parts(faces[filling], len(vertices))
    around = vertices[np.unique(faces[kept & seen])]
    distances, _ = cKDTree(around).query(vertices[faces[filling]].mean(axis=1))
    farthest = np.zeros(int(patches.max(initial=-1)) + 1)
    np.maximum.at(farthest, patches, distances)
    wide = farthest > _NARROW_HOLE * np.linalg.norm(np.ptp(around, axis=0))
    kept[filling[wide[patches]]] = False
    return kept


def used_vertices(vertices: Float64, faces: Int32) -> tuple[Float64, Int32]:
    """Return the vertices [V, 3] that triangles [F, 3] use, and the triangles with their new numbers."""
    used, numbers = np.unique(faces, return_inverse=True)
    return vertices[used], numbers.reshape(-1, 3).astype(np.int32)


def vertex_normals(vertices: Float64, faces: Int32) -> Float32:
    """Return the normal of each vertex, [V, 3]: the mean of those of its triangles, by area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    products = np.cross(b - a, c - a)
    sums = np.zeros((len(vertices), 3))
    for k in range(3):
        for axis in range(3):
            sums[:, axis] += np.bincount(faces[:, k], products[:, axis], len(vertices))
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    # A vertex whose triangles face away from each other has none: any is as good.
    sums = np.where(lengths > 0, sums / np.where(lengths > 0, lengths, 1), (0.0, 0.0, 1.0))
    return sums.astype(np.float32)


def separated(vertices: Float64, faces: Int32) -> Float64:
    """Return the vertices [V, 3] of triangles [F, 3] with no two at the same place in single precision.

    Collapses may put vertices of touching sheets there. Programs that join vertices at the same place, as all that read
    STL, would find edges of four triangles. They are moved towards their neighbours, which differ.
    """
    result = vertices.copy()
    for _ in range(_SEPARATIONS):
        _, numbers, counts = np.unique(result.astype(np.float32), axis=0, return_inverse=True, return_counts=True)
        rows = np.flatnonzero(counts[numbers.reshape(-1)] > 1)
        if not len(rows):
            break
        near = faces[np.isin(faces, rows).any(axis=1)]
        ends = np.concatenate([near[:, [k, (k + 1) % 3]] for k in range(3)])
        sums = np.column_stack([np.bincount(ends[:, 0], result[ends[:, 1], k], len(result)) for k in range(3)])
        mean = sums[rows] / np.bincount(ends[:, 0], minlength=len(result))[rows, None]
        result[rows] += _SEPARATION * (mean - result[rows])
    return result


def _parts(faces: Int32, n_vertices: int) -> Int64:
    """Return the number of the connected part of each triangle, [F]."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    graph = coo_matrix((np.ones(len(ends), np.int8), (ends[:, 0], ends[:, 1])), shape=(n_vertices, n_vertices))
    _, labels = connected_components(graph, directed=False)
    _, numbers = np.unique(labels[faces[:, 0]], return_inverse=True)
    return numbers.astype(np.int64)
