"""Surfaces of fields, as closed as they must be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from engine.meshing.cleaning import kept_faces, separated
from engine.meshing.fusion import Field
from engine.meshing.surface import extract_surface
from engine.scene import Mesh


def _mesh(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
    none = np.zeros((0, 3))
    return Mesh(
        vertices.astype(np.float32), faces, np.ones(len(faces), bool), none.astype(np.uint8), none.astype(np.float32),
        np.zeros(0, np.int32), none[:, :2].astype(np.float32), faces, np.zeros((1, 1, 4), np.uint8),
    )  # fmt: skip


def _field(values: np.ndarray) -> Field:
    for axis in range(3):
        border = np.moveaxis(values, axis, 0)
        border[0] = border[-1] = 1
    return Field(np.zeros(3), 1.0, values.astype(np.float32), np.ones(values.shape, bool))


def _ball() -> Field:
    grid = np.stack(np.meshgrid(*[np.arange(40)] * 3, indexing="ij"), axis=-1) - 19.7
    return _field(np.clip((np.linalg.norm(grid, axis=-1) - 12) / 4, -1, 1))


def test_ball_has_its_volume_and_faces_outward() -> None:
    mesh = _mesh(*extract_surface(_ball())[:2])
    assert mesh.is_closed
    assert abs(mesh.volume / (4 / 3 * np.pi * 12**3) - 1) < 0.01  # flat triangles of a ball of 12 voxels


def test_slit_is_closed_however_long_and_a_wide_hole_stays_open() -> None:
    vertices, faces, _ = extract_surface(_ball())
    x, _, z = vertices[faces].mean(axis=1).T - 19.7
    assert kept_faces(vertices, faces, (np.abs(x) > 1) | (z < 0), watertight=False).all()
    lower = z < -6
    np.testing.assert_array_equal(kept_faces(vertices, faces, ~lower, watertight=False), ~lower)
    assert kept_faces(vertices, faces, ~lower, watertight=True).all()


def test_surface_beside_a_single_measured_voxel_is_seen_within_a_voxel() -> None:
    field = _ball()
    inside = field.values < 0
    _, _, seen = extract_surface(replace(field, seen=~inside))
    # Photos measured nothing inside; all voxels outside that are beside the surface are within one voxel of it, but for
    # some across the diagonals of cells.
    assert seen.mean() > 0.9
    _, _, seen = extract_surface(replace(field, values=np.where(inside, field.values, 1), seen=~inside))
    assert not seen.any()


def test_any_field_gives_a_closed_surface() -> None:
    values = np.random.default_rng(3).normal(size=(14, 12, 13))
    values[4:6, 5, 5] = 0  # values of exactly 0 as well
    assert _mesh(*extract_surface(_field(values))[:2]).is_closed


def test_surfaces_that_touch_are_closed_also_for_programs_that_join_vertices_at_the_same_place() -> None:
    """STL has no numbers of vertices: an edge of two touching tetrahedra would have four triangles there."""
    corners = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0]], float)
    turned = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    vertices = np.concatenate([corners, corners * (-1, -1, 1)])
    faces = np.array(turned + [[a + 4, b + 4, c + 4] for a, b, c in turned], np.int32)
    assert not _mesh(vertices, faces).is_closed
    mesh = _mesh(separated(vertices, faces), faces)
    assert mesh.is_closed
    # Two vertices of each move by a twentieth of the way to their neighbours.
    assert np.abs(mesh.vertices - vertices).max() < 0.06


def test_field_without_surface_gives_no_triangles() -> None:
    vertices, faces, seen = extract_surface(_field(np.ones((6, 6, 6))))
    assert len(vertices) == len(faces) == len(seen) == 0
