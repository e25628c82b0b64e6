"""Triangles as a camera sees them: the nearest in each pixel, and how deep it is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ..core.arrays import Float32, Float64, Int32
from ..rasterizer import JIT
from ..scene import PinholeCamera

_NEAR = 1e-4
"""Depth below which a vertex is not in front of the camera."""


class Drawn(NamedTuple):
    """What a camera sees of triangles.

    Attributes
    ----------
    depth : array of shape [h, w], float32
        Infinite where there is no triangle.
    faces : array of shape [h, w], int32
        The triangle; -1 where there is none.
    weights : array of shape [h, w, 2], float32
        Of its second and third corner in the picture, without perspective.
    """

    depth: Float32
    faces: Int32
    weights: Float32


def draw_triangles(camera: PinholeCamera, vertices: Float64, faces: Int32) -> Drawn:
    """Return the nearest triangle in each pixel. Triangles with a vertex behind the camera are left out."""
    local = vertices @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    z = np.maximum(local[:, 2], 1e-6)
    x, y = (local[:, k] / z * camera.K[k, k] + camera.K[k, 2] for k in (0, 1))
    shape = (camera.height, camera.width)
    drawn = Drawn(np.full(shape, np.inf, np.float32), np.full(shape, -1, np.int32), np.zeros((*shape, 2), np.float32))
    _draw(x, y, 1 / z, local[:, 2] > _NEAR, faces, *drawn)
    return drawn


def mesh_depth(camera: PinholeCamera, vertices: Float64, faces: Int32) -> Float32:
    """Return the depth of a surface in each pixel, [h, w]; infinite where there is none."""
    return draw_triangles(camera, vertices, faces).depth


@njit(**JIT)
def _draw(x, y, inverse, front, triangles, depth, faces, weights):  # type: ignore[no-untyped-def]
    height, width = depth.shape
    for face in range(len(triangles)):
        a, b, c = triangles[face]
        if not (front[a] and front[b] and front[c]):
            continue
        area = (x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a])
        if area == 0:
            continue
        left, right = max(0.0, min(x[a], x[b], x[c]) - 0.5), min(width - 1.0, max(x[a], x[b], x[c]) + 0.5)
        top, bottom = max(0.0, min(y[a], y[b], y[c]) - 0.5), min(height - 1.0, max(y[a], y[b], y[c]) + 0.5)
        for row in range(int(top), int(bottom) + 1):
            for column in range(int(left), int(right) + 1):
                px, py = column + 0.5, row + 0.5
                s = ((px - x[a]) * (y[c] - y[a]) - (py - y[a]) * (x[c] - x[a])) / area
                t = ((x[b] - x[a]) * (py - y[a]) - (y[b] - y[a]) * (px - x[a])) / area
                if s >= 0 and t >= 0 and s + t <= 1:
                    z = 1 / (inverse[a] + s * (inverse[b] - inverse[a]) + t * (inverse[c] - inverse[a]))
                    if z < depth[row, column]:
                        depth[row, column], faces[row, column] = z, face
                        weights[row, column, 0], weights[row, column, 1] = s, t
