from __future__ import annotations

import numpy as np
import pytest

from engine.objects.evidence import connected_parts
from engine.objects.paper import calibrated, inside_hull, mean_direction, within_quartiles


def test_half_membership_is_exactly_the_cosine_threshold() -> None:
    for threshold in (0.7, 0.65, 0.0, -0.3):
        just_below = np.nextafter(np.float32(threshold), np.float32(-2))
        cosines = np.array([-1, just_below, threshold, 1], np.float32)
        membership = calibrated(cosines, threshold)
        assert membership.tolist()[0] == 0.0 and membership.tolist()[2:] == [0.5, 1.0]
        assert membership[1] < 0.5
    grid = calibrated(np.linspace(-1, 1, 1001), 0.7)
    assert (np.diff(grid) >= 0).all()


def test_mean_direction_ignores_a_fringe_of_other_features() -> None:
    rng = np.random.default_rng(0)
    mine = np.eye(16)[0] + 0.05 * rng.normal(size=(200, 16))
    fringe = np.eye(16)[1] + 0.05 * rng.normal(size=(60, 16))
    features = np.concatenate([mine, fringe]).astype(np.float32)
    features /= np.linalg.norm(features, axis=1, keepdims=True)
    direction = mean_direction(features, 0.7)
    assert direction is not None and direction[0] > 0.99
    assert mean_direction(features[:0], 0.7) is None


def test_part_outside_of_the_evidence_mask_is_left_out() -> None:
    rng = np.random.default_rng(1)
    near, far = rng.normal(size=(300, 3)) * 0.2, rng.normal(size=(500, 3)) * 0.2 + 5
    points = np.concatenate([near, far]).astype(np.float32)
    seed = np.r_[rng.random(300), np.zeros(500)]
    kept = connected_parts(points, seed)
    assert kept[:300].mean() > 0.95 and not kept[300:].any()


def test_both_halves_of_an_object_behind_a_pole_are_kept() -> None:
    rng = np.random.default_rng(2)
    points = (rng.normal(size=(600, 3)) * 0.1 + np.repeat([[0, 0, 0], [1.5, 0, 0]], 300, axis=0)).astype(np.float32)
    assert connected_parts(points, np.ones(600)).mean() > 0.95


def test_hull_fills_the_inside_only() -> None:
    rng = np.random.default_rng(3)
    corners = rng.uniform(-1, 1, (200, 3)).astype(np.float32)
    points = np.array([[0, 0, 0], [0.3, 0.3, -0.3], [2, 0, 0]], np.float32)
    assert inside_hull(corners, points).tolist() == [True, True, False]


@pytest.mark.parametrize("seed", range(3))
def test_hull_agrees_with_scipys_search_in_its_tetrahedra(seed: int) -> None:
    from scipy.spatial import Delaunay

    rng = np.random.default_rng(seed)
    corners, points = rng.normal(size=(60, 3)).astype(np.float32), rng.normal(size=(2000, 3)).astype(np.float32)
    np.testing.assert_array_equal(inside_hull(corners, points), Delaunay(corners).find_simplex(points) >= 0)


def test_flat_and_tiny_objects_have_no_hull() -> None:
    flat = np.random.default_rng(4).uniform(-1, 1, (50, 3)).astype(np.float32)
    flat[:, 2] = 0.5
    for corners in (flat, flat[:3], flat[:0]):
        assert not inside_hull(corners, flat).any()


def test_stray_gaussian_does_not_inflate_the_hull() -> None:
    points = np.random.default_rng(5).normal(size=(300, 3)).astype(np.float32)
    points[0] = 100
    keep = within_quartiles(points, 1.5)
    assert not keep[0] and keep.mean() > 0.9
    assert within_quartiles(points[:0], 1.0).shape == (0,)
