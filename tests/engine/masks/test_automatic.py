"""A whole photo is segmented into a label map."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.core.errors import Cancelled, SettingsError
from engine.masks import mask_iou
from engine.masks.automatic import _Candidate, _Found, label_map_size, paint_labels, segment_everything
from engine.masks.sam import SegmentAnything
from engine.masks.settings import PRESETS, MaskSettings
from tests.engine import museum
from tests.engine.masks.shapes import iou, shapes_picture

QUICK = replace(MaskSettings(), max_prompts=20)


def _assert_ids_without_gaps(labels: np.ndarray) -> None:
    assert labels.dtype == np.int32
    assert set(np.unique(labels)) | {0} == set(range(labels.max() + 1))


@pytest.mark.parametrize("seed", [0, 5])
def test_each_shape_of_a_picture_gets_its_own_label(sam: SegmentAnything, seed: int) -> None:
    picture, masks = shapes_picture(seed)
    before = picture.copy()
    labels = segment_everything(sam.encode(picture), sam, QUICK)
    assert labels.shape == (480, 640) and np.array_equal(picture, before)
    _assert_ids_without_gaps(labels)
    matched = set()
    for name, mask in masks.items():
        scores = [iou(labels == number, mask) for number in range(1, labels.max() + 1)]
        assert max(scores) > 0.9, name  # seen: 0.95 and more
        matched.add(int(np.argmax(scores)))
    assert len(matched) == len(masks)


def test_label_map_is_reduced_but_never_larger_than_the_photo(sam: SegmentAnything) -> None:
    assert label_map_size(480, 640, 1024) == (480, 640)
    assert label_map_size(3000, 4000, 1024) == (768, 1024)
    assert label_map_size(1, 4000, 64) == (1, 64)
    labels = segment_everything(sam.encode(shapes_picture()[0]), sam, replace(QUICK, max_side=320, max_prompts=3))
    assert labels.shape == (240, 320)


def test_plain_picture_gives_a_label_map_without_an_error(sam: SegmentAnything) -> None:
    labels = segment_everything(sam.encode(np.full((90, 120, 3), 128, np.uint8)), sam, replace(QUICK, max_prompts=4))
    assert labels.shape == (90, 120)
    _assert_ids_without_gaps(labels)


def test_cancel_is_checked_between_clicks(sam: SegmentAnything) -> None:
    calls: list[int] = []

    def stop() -> bool:
        calls.append(1)
        return len(calls) > 2

    with pytest.raises(Cancelled):
        segment_everything(sam.encode(shapes_picture()[0]), sam, QUICK, should_stop=stop)
    assert len(calls) == 3


def _square(size: int, start: int, side: int) -> np.ndarray:
    mask = np.zeros((size, size), bool)
    mask[start : start + side, start : start + side] = True
    return mask


def test_small_masks_are_painted_over_large_ones_whatever_their_order() -> None:
    large, small = _square(100, 10, 80), _square(100, 40, 20)
    for order in ([large, small], [small, large]):
        labels = paint_labels(order, (100, 100), min_area=50)
        assert labels[15, 15] == 1 and labels[50, 50] == 2 and labels[0, 0] == 0


def test_painting_by_score_shows_the_last_mask_on_top() -> None:
    large, small = _square(100, 10, 80), _square(100, 40, 20)
    labels = paint_labels([small, large], (100, 100), min_area=50, painting="score")
    assert labels[50, 50] == 1 and labels.max() == 1


def test_islands_are_removed_and_holes_are_filled() -> None:
    mask = _square(100, 10, 60)
    mask[30:34, 30:34] = False
    mask[90:94, 90:94] = True
    labels = paint_labels([mask], (100, 100), min_area=50)
    assert labels[32, 32] == 1 and labels[91, 91] == 0 and labels.max() == 1


def test_more_than_255_masks_keep_their_ids() -> None:
    masks = []
    for row in range(20):
        for column in range(20):
            mask = np.zeros((240, 240), bool)
            mask[row * 12 : row * 12 + 11, column * 12 : column * 12 + 11] = True
            masks.append(mask)
    labels = paint_labels(masks, (240, 240), min_area=100)
    assert labels.max() == 400
    _assert_ids_without_gaps(labels)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 6), st.integers(1, 40))
def test_label_maps_of_random_masks_have_valid_ids_and_areas(seed: int, count: int, min_area: int) -> None:
    generator = np.random.default_rng(seed)
    masks = []
    for _ in range(count):
        mask = np.zeros((40, 50), bool)
        y, x = generator.integers(0, 30, 2)
        mask[y : y + generator.integers(1, 40), x : x + generator.integers(1, 40)] = True
        masks.append(mask ^ (generator.random((40, 50)) < 0.02))
    labels = paint_labels(masks, (40, 50), min_area=min_area)
    _assert_ids_without_gaps(labels)
    assert labels.max() <= count
    for number in range(1, labels.max() + 1):
        assert np.count_nonzero(labels == number) >= min_area


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40))
def test_holes_and_islands_are_those_of_the_whole_picture_also_at_its_edge(seed: int, min_area: int) -> None:
    generator = np.random.default_rng(seed)
    # Blobs of all sizes, of which many touch the edge.
    noise = cv2.GaussianBlur(generator.random((40, 50)).astype(np.float32), (0, 0), generator.uniform(0.5, 4.0))
    mask = noise > np.quantile(noise, generator.uniform(0.1, 0.9))

    def without_islands(given_mask: np.ndarray) -> np.ndarray:
        _, components, statistics, _ = cv2.connectedComponentsWithStats(given_mask.astype(np.uint8), connectivity=8)
        keep = statistics[:, cv2.CC_STAT_AREA] >= min_area
        keep[0] = False
        return np.asarray(keep[components])

    expected = without_islands(~without_islands(~without_islands(mask)))
    labels = paint_labels([mask], (40, 50), min_area=min_area)
    np.testing.assert_array_equal(labels > 0, expected)


def test_same_photo_gives_the_same_label_map_whatever_was_segmented_before(sam: SegmentAnything) -> None:
    first, other = (sam.encode(shapes_picture(seed)[0]) for seed in (5, 0))
    labels = segment_everything(first, sam, QUICK)
    segment_everything(other, sam, QUICK)
    np.testing.assert_array_equal(segment_everything(first, sam, QUICK), labels)


def test_label_map_is_the_same_when_no_mask_is_given_up_early(
    sam: SegmentAnything, monkeypatch: pytest.MonkeyPatch
) -> None:
    embedding, few = sam.encode(np.asarray(museum.picture(8, (480, 360)))), replace(QUICK, max_prompts=8)
    labels = segment_everything(embedding, sam, few)
    predict = SegmentAnything.predict_scales
    given_up: list[bool] = []

    def in_full(*arguments: Any, min_stability: float, **options: Any) -> Any:
        assert min_stability == QUICK.min_stability
        early = predict(*arguments, min_stability=min_stability, **options)
        full = predict(*arguments, **options)
        given_up.append(not all(np.array_equal(one[0], other[0]) for one, other in zip(early, full, strict=True)))
        return full

    monkeypatch.setattr(SegmentAnything, "predict_scales", in_full)
    np.testing.assert_array_equal(segment_everything(embedding, sam, few), labels)
    assert any(given_up)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 0.9))
def test_clicks_keep_away_from_the_masks_that_are_left_after_better_ones_replaced_others(
    seed: int, max_overlap: float
) -> None:
    generator = np.random.default_rng(seed)
    found, expected = _Found(20, 30), list[_Candidate]()
    for _ in range(12):
        mask = np.zeros((20, 30), bool)
        y, x = generator.integers(0, 15, 2)
        mask[y : y + generator.integers(1, 20), x : x + generator.integers(1, 20)] = True
        candidate = _Candidate(mask.astype(np.float32), mask, generator.integers(4) / 4, np.count_nonzero(mask))
        rivals = [other for other in expected if mask_iou(mask, other.mask) > max_overlap]
        if not any(other.iou >= candidate.iou for other in rivals):
            expected = [other for other in expected if not any(other is rival for rival in rivals)] + [candidate]
        found.admit(candidate, max_overlap)
        assert [id(each) for each in found.masks] == [id(each) for each in expected]
    tried = (generator.random((20, 30)) < 0.1).astype(np.uint8)
    covered = np.any([tried > 0, *(each.mask for each in expected)], axis=0)
    free = np.pad(~covered, 1).astype(np.uint8)
    np.testing.assert_array_equal(
        found.distance_of_free(tried), cv2.distanceTransform(free, cv2.DIST_L2, 3)[1:-1, 1:-1]
    )


def test_settings_out_of_bounds_are_named() -> None:
    with pytest.raises(SettingsError, match="`MaskSettings.max_prompts` must be at least 1, got 0"):
        MaskSettings(max_prompts=0)
    with pytest.raises(SettingsError, match="min_iou"):
        MaskSettings(min_iou=1.5)
    with pytest.raises(SettingsError, match="at least 1 for the published generator"):
        MaskSettings(generator="published", grid=0)
    assert set(PRESETS) == {"default", "published", "paper"}
