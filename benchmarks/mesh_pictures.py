"""Pictures of meshes: their textures without light, as photos show the colours, and their shapes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engine.meshing.drawing import draw_triangles
from engine.scene import Mesh, PinholeCamera


def draw_mesh(
    mesh: Mesh, camera: PinholeCamera, *, background: Sequence[float] = (0.0, 0.0, 0.0), finer: int = 1
) -> np.ndarray:
    """Return the colours of a mesh before a background, [h, w, 3], float32, sRGB from 0 to 1.

    `finer` rows and columns are drawn for each of the picture, and averaged: a pixel of a photo shows an area.
    """
    picture = _drawn(mesh, camera.scaled(finer), background)
    return picture.reshape(camera.height, finer, camera.width, finer, 3).mean(axis=(1, 3))


def draw_shape(mesh: Mesh, camera: PinholeCamera, *, background: Sequence[float]) -> np.ndarray:
    """Return the shape of a mesh, lit from the camera, before a background, [h, w, 3], float32, 0 to 1."""
    _, faces, weights = draw_triangles(camera, mesh.vertices.astype(np.float64), mesh.faces)
    shown = faces >= 0
    normals = (mesh.normals[mesh.faces[faces[shown]]] * _corners(weights[shown])[..., None]).sum(axis=1)
    toward = -(normals @ camera.viewmat[2, :3].astype(np.float32)) / np.linalg.norm(normals, axis=1)
    picture = np.full((*faces.shape, 3), background, np.float32)
    picture[shown] = (0.15 + 0.75 * np.abs(toward))[:, None]
    return picture


def _corners(weights: np.ndarray) -> np.ndarray:
    """Return the weights of the three corners, [P, 3], from those of the second and third one."""
    s, t = weights.T
    return np.stack([1 - s - t, s, t], axis=1)


def _drawn(mesh: Mesh, camera: PinholeCamera, background: Sequence[float]) -> np.ndarray:
    vertices = mesh.vertices.astype(np.float64)
    _, faces, weights = draw_triangles(camera, vertices, mesh.faces)
    z = np.maximum(vertices @ camera.viewmat[2, :3] + camera.viewmat[2, 3], 1e-6)
    shown = faces >= 0
    corners = _corners(weights[shown]) / z[mesh.faces[faces[shown]]]
    corners /= corners.sum(axis=1, keepdims=True)
    uv = (mesh.uv[mesh.texture_faces[faces[shown]]] * corners[..., None]).sum(axis=1)
    side = mesh.texture.shape[0]
    columns = np.clip((uv[:, 0] * side).astype(int), 0, side - 1)
    rows = np.clip(((1 - uv[:, 1]) * side).astype(int), 0, side - 1)
    picture = np.full((*faces.shape, 3), background, np.float32)
    picture[shown] = mesh.texture[rows, columns, :3] / np.float32(255)
    return picture
