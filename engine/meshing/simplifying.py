"""Fewer triangles with nearly the same surface."""

from __future__ import annotations

import fast_simplification
import manifold3d
import numpy as np
from scipy.spatial import cKDTree

from ..core.arrays import Float64, Int32, Mask
from ..scene import are_closed
from .cleaning import used_vertices

_OTHER_SHARES = (0.96, 0.92, 0.88, 0.84, 0.8)
"""Shares of the wanted number that are tried for a closed surface: quadrics may let parts of it touch."""

_STEPS, _STEP_RANGE = 24, (1.1, 2.0)
"""Largest number of tolerances by which a closed surface is simplified, and how much each is larger."""


def simplified(
    vertices: Float64, faces: Int32, seen: Mask, *, triangles: int, closed: bool
) -> tuple[Float64, Int32, Mask]:
    """Return a surface of about `triangles` triangles, or as it is when it has no more.

    Parameters
    ----------
    vertices : array of shape [V, 3], float64
    faces : array of shape [F, 3], int32
    seen : array of shape [F], bool
        Whether photos saw each triangle. Each new one takes it from the nearest old one.
    closed : bool
        Whether the surface is closed and has to stay so. Quadrics alone may let parts touch.
    """
    if len(faces) <= triangles:
        return vertices, faces, seen
    new_vertices, new_faces = _by_quadrics(vertices, faces, triangles)
    if closed:
        for share in _OTHER_SHARES:
            if are_closed(new_faces):
                break
            new_vertices, new_faces = _by_quadrics(vertices, faces, round(share * triangles))
        else:
            new_vertices, new_faces = _closed_simplified(vertices, faces, triangles)
    tree = cKDTree(vertices[faces].mean(axis=1))
    _, nearest = tree.query(new_vertices[new_faces].mean(axis=1))
    return new_vertices, new_faces, seen[nearest]


def _by_quadrics(vertices: Float64, faces: Int32, triangles: int) -> tuple[Float64, Int32]:
    """Return a surface of at most `triangles` triangles, or a few more, by collapses of least error."""
    points, corners = fast_simplification.simplify(vertices, faces, target_count=triangles)
    return used_vertices(np.asarray(points, np.float64), np.asarray(corners, np.int32))


def _closed_simplified(vertices: Float64, faces: Int32, triangles: int) -> tuple[Float64, Int32]:
    """Return a closed surface of at most `triangles` triangles by collapses within a tolerance."""
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.uint64))
    )
    tolerance = float(np.linalg.norm(np.ptp(vertices, axis=0))) / 5000
    best = solid
    for _ in range(_STEPS):
        # Where the tolerance decides, the number of triangles is about inverse to it.
        tolerance *= min(_STEP_RANGE[1], max(_STEP_RANGE[0], best.num_tri() / triangles))
        best = best.simplify(tolerance)
        if best.num_tri() <= triangles:
            break
    mesh = best.to_mesh64()
    return np.asarray(mesh.vert_properties[:, :3], np.float64), np.asarray(mesh.tri_verts, np.int32)
