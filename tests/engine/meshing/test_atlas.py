"""The places of triangles in a texture."""

from __future__ import annotations

import numpy as np
import pytest

from engine.meshing.atlas import make_atlas

N = 40


@pytest.mark.parametrize("size", [1e-5, 1e-2, 1.0, 1e4])
def test_every_triangle_has_a_place_whatever_the_size_of_the_object(size: float) -> None:
    x, y = np.meshgrid(np.linspace(0, 1, N), np.linspace(0, 1, N) ** 3, indexing="ij")  # small and large triangles
    vertices = size * np.stack([x, y, 0.1 * np.sin(6 * x)], axis=-1).reshape(-1, 3)
    a = (np.arange(N - 1)[:, None] * N + np.arange(N - 1)).ravel()
    faces = np.concatenate([np.stack([a, a + N, a + 1], 1), np.stack([a + 1, a + N, a + N + 1], 1)]).astype(np.int32)
    corners, texture_faces, uv = make_atlas(vertices, faces, 256)
    assert np.array_equal(corners[texture_faces], faces)
    first, second = (uv[texture_faces[:, k]] - uv[texture_faces[:, 0]] for k in (1, 2))
    areas = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    assert np.all(areas > 0)
