from __future__ import annotations

import numpy as np
import pytest

from engine.errors import SettingsError
from engine.objects.lifting import snap_to_segments
from engine.objects.selection import (
    HALF,
    calibrated,
    connected_parts,
    inside_hull,
    mean_direction,
    within_quartiles,
    without_far,
)
from engine.objects.settings import DEFAULT_PRESET, PRESETS, SegmentSettings
from engine.objects.views import erode_mask, spread_cameras
from tests.engine.pictures.blob_scene import BlobScene


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
    direction = mean_direction(features)
    assert direction is not None and direction[0] > 0.99
    assert mean_direction(features[:0]) is None


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


def test_masks_take_the_outline_of_the_segments_they_fill() -> None:
    labels = np.zeros((20, 30), np.int32)
    labels[5:15, 5:15], labels[5:15, 15:25] = 1, 2
    mask = np.zeros((20, 30), bool)
    mask[4:14, 6:17] = True
    snapped = snap_to_segments(mask, labels)
    assert snapped[labels == 1].all() and not snapped[labels == 2].any()
    assert snapped[4, 8], "a pixel without segment stays"


def test_segments_that_do_not_match_the_object_are_ignored() -> None:
    labels = np.ones((20, 20), np.int32)
    mask = np.zeros((20, 20), bool)
    mask[5:10, 5:10] = True
    np.testing.assert_array_equal(snap_to_segments(mask, labels), mask)


def test_thin_masks_survive_erosion() -> None:
    line = np.zeros((20, 20), bool)
    line[10] = True
    assert erode_mask(line, 3).any()


def test_sampled_views_are_spread_and_none_twice(blobs: BlobScene) -> None:
    chosen = spread_cameras(blobs.cameras.cameras, 4)
    centers = np.stack([camera.center for camera in chosen])
    gaps = np.linalg.norm(centers[:, None] - centers[None], axis=-1)[np.triu_indices(4, 1)]
    assert gaps.min() > 1.5
    assert len(spread_cameras(blobs.cameras.cameras, 99)) == len(blobs.cameras.cameras)


def test_settings_out_of_bounds_are_refused() -> None:
    assert DEFAULT_PRESET in PRESETS and PRESETS["paper"].cosine == 0.7
    for field, value in (("cosine", 1.0), ("n_text_views", 0), ("completion", "balloon"), ("outlier_iqr", 0.0)):
        with pytest.raises(SettingsError, match=f"SegmentSettings.{field}"):
            SegmentSettings(**{field: value})  # type: ignore[arg-type]


def _vase_on_a_plate() -> np.ndarray:
    """300 positions of a vase 0.6 high, and 30 of a thin plate of radius 0.25 below it."""
    rng = np.random.default_rng(3)
    vase = rng.random((300, 3)) * (0.1, 0.1, 0.6) - (0.05, 0.05, 0)
    angles = rng.random(30) * 2 * np.pi
    plate = np.stack([0.25 * np.cos(angles), 0.25 * np.sin(angles), np.zeros(30)], axis=1)
    return np.concatenate([vase, plate]).astype(np.float32)


def test_single_gaussian_far_away_is_no_part_of_the_object() -> None:
    points = np.concatenate([_vase_on_a_plate(), [[0.0, -3.0, 0.5], [0.0, 2.5, 1.0]]]).astype(np.float32)
    membership = without_far(points, np.full(332, 0.9, np.float32), np.ones(332, bool))
    assert (membership[:330] == np.float32(0.9)).all() and (membership[330:] == 0).all()


def test_lower_threshold_adds_what_lies_next_to_the_object_and_nothing_far_away() -> None:
    points = np.concatenate([_vase_on_a_plate(), [[0.0, 0.0, 0.65], [0.0, 0.0, 30.0]]]).astype(np.float32)
    membership = without_far(points, np.full(332, 0.8, np.float32), np.arange(332) < 330)
    assert 0 < membership[330] < HALF and membership[331] == 0


def test_object_without_members_is_nowhere() -> None:
    assert (without_far(_vase_on_a_plate(), np.full(330, 0.4, np.float32), np.zeros(330, bool)) == 0).all()
