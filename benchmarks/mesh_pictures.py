"""Pictures of textured meshes without light, as photos show their colours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engine.meshing.drawing import draw_triangles
from engine.scene import Mesh, PinholeCamera

__all__ = ["draw_mesh"]


def draw_mesh(mesh: Mesh, camera: PinholeCamera, *, background: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Return the colours of a mesh before a background, [h, w, 3], float32, sRGB from 0 to 1."""
    vertices = mesh.vertices.astype(np.float64)
    _, faces, weights = draw_triangles(camera, vertices, mesh.faces)
    z = np.maximum(vertices @ camera.viewmat[2, :3] + camera.viewmat[2, 3], 1e-6)
    shown = faces >= 0
    s, t = weights[shown].T
    corners = np.stack([1 - s - t, s, t], axis=1) / z[mesh.faces[faces[shown]]]
    corners /= corners.sum(axis=1, keepdims=True)
    uv = (mesh.uv[mesh.texture_faces[faces[shown]]] * corners[..., None]).sum(axis=1)
    side = mesh.texture.shape[0]
    columns = np.clip((uv[:, 0] * side).astype(int), 0, side - 1)
    rows = np.clip(((1 - uv[:, 1]) * side).astype(int), 0, side - 1)
    picture = np.full((*faces.shape, 3), background, np.float32)
    picture[shown] = mesh.texture[rows, columns, :3] / np.float32(255)
    return picture
