"""Pictures of textured meshes without light, as photos show their colours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from engine.scene import Mesh, PinholeCamera

__all__ = ["draw_mesh"]


def draw_mesh(mesh: Mesh, camera: PinholeCamera, *, background: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Return the colours of a mesh before a background, [h, w, 3], float32, sRGB from 0 to 1."""
    local = mesh.vertices.astype(np.float64) @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    z = np.maximum(local[:, 2], 1e-6)
    x, y = (local[:, k] / z * camera.K[k, k] + camera.K[k, 2] for k in (0, 1))
    shape = (camera.height, camera.width)
    depth, faces, weights = np.full(shape, np.inf), np.full(shape, -1), np.zeros((*shape, 2))
    _draw(x, y, 1 / z, mesh.faces, depth, faces, weights)
    shown = faces >= 0
    s, t = weights[shown].T
    corners = np.stack([1 - s - t, s, t], axis=1) / z[mesh.faces[faces[shown]]]
    corners /= corners.sum(axis=1, keepdims=True)
    uv = (mesh.uv[mesh.texture_faces[faces[shown]]] * corners[..., None]).sum(axis=1)
    side = mesh.texture.shape[0]
    columns = np.clip((uv[:, 0] * side).astype(int), 0, side - 1)
    rows = np.clip(((1 - uv[:, 1]) * side).astype(int), 0, side - 1)
    picture = np.full((*shape, 3), background, np.float32)
    picture[shown] = mesh.texture[rows, columns, :3] / np.float32(255)
    return picture


@njit(cache=False)
def _draw(x, y, inverse, triangles, depth, faces, weights):  # type: ignore[no-untyped-def]
    height, width = depth.shape
    for face in range(len(triangles)):
        a, b, c = triangles[face]
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
