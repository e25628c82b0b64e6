"""Overlap and bounding box of masks, on masks whose answers are known."""

from __future__ import annotations

import numpy as np
import pytest

from engine.masks.mask_geometry import mask_box, mask_iou, suppress_overlapping


def test_iou_of_shifted_squares() -> None:
    first, second = np.zeros((10, 10), bool), np.zeros((10, 10), bool)
    first[0:4, 0:4], second[0:4, 2:6] = True, True
    assert mask_iou(first, second) == mask_iou(second, first) == pytest.approx(8 / 24)
    assert mask_iou(first, first) == 1.0


def test_iou_of_empty_masks_is_0() -> None:
    empty, full = np.zeros(5, bool), np.ones(5, bool)
    assert mask_iou(empty, empty) == mask_iou(empty, full) == 0.0


def test_box_is_half_open_and_cuts_out_the_mask() -> None:
    mask = np.zeros((20, 30), bool)
    mask[3, 7] = mask[11, 29] = True
    box = mask_box(mask)
    assert box == (7, 3, 30, 12)
    assert all(type(side) is int for side in box)
    assert mask[box[1] : box[3], box[0] : box[2]].sum() == mask.sum()


def test_empty_mask_has_no_box() -> None:
    assert mask_box(np.zeros((4, 5), bool)) is None


def test_of_boxes_that_overlap_more_than_allowed_the_best_is_kept() -> None:
    boxes = [(0, 0, 10, 10), (0, 0, 10, 8), (20, 0, 30, 10), (25, 0, 35, 10)]
    assert suppress_overlapping(boxes, [0.5, 0.9, 0.1, 0.3], 0.5) == [1, 3, 2]
    assert suppress_overlapping(boxes, [0.5, 0.9, 0.1, 0.3], 0.8) == [1, 0, 3, 2]
    assert suppress_overlapping([], [], 0.5) == []
