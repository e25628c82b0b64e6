"""Overlap and bounding box of boolean masks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["mask_box", "mask_iou"]

Mask = NDArray[np.bool_]


def mask_iou(first: Mask, second: Mask) -> float:
    """Return the intersection over union of two masks, 0 to 1; 0 when both are empty.

    Parameters
    ----------
    first, second : bool arrays of the same shape
        Pixels of a picture, or Gaussians of a scene.
    """
    union = int(np.count_nonzero(first | second))
    return int(np.count_nonzero(first & second)) / union if union else 0.0


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
