"""Overlap of boolean masks and of boxes, and the bounding box of a mask."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core.arrays import Float32, Mask


def mask_iou(first: Mask, second: Mask) -> float:
    """Return the intersection over union of two masks, 0 to 1; 0 when both are empty.

    Parameters
    ----------
    first, second : bool arrays of the same shape
        Pixels of a picture, or Gaussians of a scene.
    """
    union = int(np.count_nonzero(first | second))
    return int(np.count_nonzero(first & second)) / union if union else 0.0


def box_ious(boxes: Float32, box: Float32) -> Float32:
    """Return the intersection over union of each of `boxes`, shape [N, 4], with one box, shape [4]: x0, y0, x1, y1."""
    sides = np.clip(np.minimum(boxes[:, 2:], box[2:]) - np.maximum(boxes[:, :2], box[:2]), 0, None)
    intersection = sides.prod(axis=1)
    union = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1) + (box[2:] - box[:2]).prod() - intersection
    return np.asarray(intersection / np.maximum(union, 1e-9), np.float32)


def suppress_overlapping(boxes: ArrayLike, scores: ArrayLike, max_overlap: float) -> list[int]:
    """Return the numbers of the boxes that non-maximum suppression keeps, the highest score first.

    Parameters
    ----------
    boxes : array-like of shape [N, 4]
        x0, y0, x1, y1.
    scores : array-like of shape [N]
        At least 0.
    max_overlap : float
        Largest intersection over union of two boxes that are kept, 0 to 1.
    """
    import cv2

    corners = np.asarray(boxes, np.float64).reshape(-1, 4)
    places = np.hstack([corners[:, :2], corners[:, 2:] - corners[:, :2]])
    kept = cv2.dnn.NMSBoxes(places.tolist(), np.asarray(scores, np.float64).tolist(), 0.0, max_overlap)
    return [int(number) for number in kept]


def mask_box(mask: Mask) -> tuple[int, int, int, int] | None:
    """Return the bounding box x0, y0, x1, y1 of a mask; None when it is empty.

    Parameters
    ----------
    mask : bool array of shape [H, W]

    Returns
    -------
    tuple of 4 int, or None
        Half-open: x1 is one more than the last column and y1 one more than the last row, so ``mask[y0:y1, x0:x1]``
        contains every pixel of the mask.
    """
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    if len(columns) == 0:
        return None
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
