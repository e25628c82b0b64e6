from __future__ import annotations

import cv2
import numpy as np
import pytest

from engine.masks.mask_metrics import boundary, boundary_iou, feature_agreement, halo, holes, iou, stray


def square(left: int, size: int, *, side: int = 100) -> np.ndarray:
    mask = np.zeros((side, side), bool)
    mask[20 : 20 + size, left : left + size] = True
    return mask


def test_iou_of_shifted_squares() -> None:
    assert iou(square(20, 40), square(20, 40)) == 1.0
    assert iou(square(20, 40), square(40, 40)) == pytest.approx(1 / 3)


def test_missing_or_empty_prediction_counts_0() -> None:
    assert iou(None, square(20, 40)) == 0.0
    assert boundary_iou(None, square(20, 40)) == 0.0
    assert iou(np.zeros((100, 100), bool), square(20, 40)) == 0.0
    assert iou(np.zeros((4, 4), bool), np.zeros((4, 4), bool)) == 0.0


def test_masks_of_two_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="one shape"):
        iou(np.ones((2, 2), bool), np.ones((2, 3), bool))
    with pytest.raises(ValueError, match="one shape"):
        boundary_iou(np.ones((2, 2), bool), np.ones((2, 3), bool))


@pytest.mark.parametrize("shape", [(60, 90), (75, 40), (1, 1), (3, 200), (5, 5)])
@pytest.mark.parametrize("seed", range(3))
def test_boundary_is_what_the_benchmarks_erosions_leave(shape: tuple[int, int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.random(shape), (0, 0), 3)
    mask = noise > np.median(noise) if max(shape) > 5 else np.ones(shape, bool)
    # The benchmark's definition, word for word, by OpenCV: pad one pixel, erode d times with 3x3.
    distance = max(1, round(0.02 * float(np.hypot(*shape))))
    padded = np.pad(mask, 1).astype(np.uint8)
    eroded = cv2.erode(padded, np.ones((3, 3), np.uint8), iterations=distance)[1:-1, 1:-1]
    np.testing.assert_array_equal(boundary(mask), mask & (eroded == 0))


def test_boundary_iou_punishes_a_rim_that_is_off_more_than_iou() -> None:
    truth, shifted = square(20, 60), square(22, 60)
    assert boundary_iou(shifted, truth) < iou(shifted, truth) < 1.0


def test_perfect_features_agree_and_random_ones_do_not() -> None:
    labels = np.zeros((40, 60), np.int32)
    labels[:, :20], labels[:, 20:50] = 1, 2
    features = np.eye(16)[labels].astype(np.float32)
    assert feature_agreement(features, labels) == 1.0
    random = np.random.default_rng(0).normal(size=features.shape)
    assert feature_agreement(random, labels) < 0.1


def test_features_that_mix_two_segments_agree_less() -> None:
    labels = np.repeat([[1, 2]], 40, axis=0).repeat(20, axis=1)
    assert feature_agreement(np.ones((40, 40, 16)), labels) == pytest.approx(0.5)


def test_uncovered_pixels_agree_with_nothing() -> None:
    labels = np.ones((20, 20), np.int32)
    assert feature_agreement(np.ones((20, 20, 4)), labels, alpha=np.zeros((20, 20))) == 0.0


def test_no_segment_is_not_a_number() -> None:
    assert np.isnan(feature_agreement(np.ones((20, 20, 4)), np.zeros((20, 20), np.int32)))


def test_halo_stray_and_holes_share_out_what_is_wrong() -> None:
    # 100 x 100 pixels: the band is round(2.83) = 3 wide.
    truth = square(20, 40)
    grown = np.zeros_like(truth)
    grown[15:65, 15:65] = True
    assert halo(grown, truth) == pytest.approx((46**2 - 40**2) / 40**2)
    assert stray(grown, truth) == pytest.approx((50**2 - 46**2) / 40**2)
    assert holes(grown, truth) == 0.0
    left_half = square(20, 40) & (np.arange(100) < 40)
    assert (halo(left_half, truth), stray(left_half, truth), holes(left_half, truth)) == (0.0, 0.0, 0.5)
    assert (halo(truth, truth), stray(truth, truth), holes(truth, truth)) == (0.0, 0.0, 0.0)


def test_nothing_found_is_one_hole() -> None:
    assert holes(None, square(20, 40)) == 1.0
    with pytest.raises(ValueError, match="one shape"):
        halo(np.ones((2, 2), bool), np.ones((2, 3), bool))
