"""Metrics of a predicted mask against the true one, as defined by the LERF-Mask benchmark. NumPy only."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Mask, normalized
from . import mask_iou
from .settings import INSTANCE_COSINE

_MIN_AGREEMENT_PIXELS = 100
"""Pixels of a segment below which `feature_agreement` leaves it out."""


def iou(predicted: Mask | None, truth: Mask) -> float:
    """Return the intersection over union of two masks.

    Parameters
    ----------
    predicted : bool array of shape [H, W], or None
        None when nothing was found, which counts 0. (The benchmark's own script skips missing predictions, which
        rewards predicting nothing.)
    truth : bool array of shape [H, W]

    Returns
    -------
    float
        0 to 1; 0 when both are empty, where the benchmark's script gives NaN.

    Raises
    ------
    ValueError
        When the shapes differ.
    """
    if predicted is None:
        return 0.0
    _require_same_shape(predicted, truth)
    return mask_iou(predicted, truth)


def boundary(mask: Mask) -> Mask:
    """Return the band inside of a mask along its border and along the border of the picture.

    The band is d = max(1, round(0.02 * sqrt(h^2 + w^2))) pixels wide: it is removed by d
    erosions with a 3 x 3 square from the mask padded with one empty pixel.

    Parameters
    ----------
    mask : bool array of shape [H, W]

    Returns
    -------
    bool array of shape [H, W]
    """
    # d erosions with a 3x3 square keep a pixel when the (2d+1) x (2d+1) square around it is full; padding beyond
    # one pixel changes nothing, since one empty pixel already erodes d pixels deep.
    distance = _band(mask.shape)
    return np.logical_and(mask, _count_around(mask, distance) < (2 * distance + 1) ** 2)


def _band(shape: tuple[int, ...]) -> int:
    """Return the width of the boundary band in pixels: 0.02 of the picture's diagonal."""
    return max(1, round(0.02 * math.hypot(*shape)))


def _count_around(mask: Mask, distance: int) -> NDArray[np.int64]:
    """Return for each pixel how many pixels of the mask lie in the square of radius `distance` around it."""
    # Counted with a summed-area table.
    padded = np.pad(mask, distance).astype(np.int64)
    table = np.pad(padded, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    side = 2 * distance + 1
    count: NDArray[np.int64] = table[side:, side:] - table[:-side, side:] - table[side:, :-side] + table[:-side, :-side]
    return count


def boundary_iou(predicted: Mask | None, truth: Mask) -> float:
    """Return the intersection over union of the boundaries of two masks, see `boundary`.

    Parameters
    ----------
    predicted : bool array of shape [H, W], or None
        None counts 0.
    truth : bool array of shape [H, W]

    Returns
    -------
    float
    """
    if predicted is None:
        return 0.0
    _require_same_shape(predicted, truth)
    return iou(boundary(predicted), boundary(truth))


def halo(predicted: Mask, truth: Mask) -> float:
    """Return the share of predicted pixels just outside of the true mask.

    Parameters
    ----------
    predicted : bool array of shape [H, W]
    truth : bool array of shape [H, W]
        Not empty.

    Returns
    -------
    float
        Predicted pixels outside of the truth that have a true pixel in the square reaching d pixels around them, d as
        in `boundary`; divided by the true pixels.
    """
    return _outside(predicted, truth, near=True)


def stray(predicted: Mask, truth: Mask) -> float:
    """Return the share of predicted pixels farther outside of the truth than `halo` counts; see there."""
    return _outside(predicted, truth, near=False)


def holes(predicted: Mask | None, truth: Mask) -> float:
    """Return the share of the true mask, not empty, that the prediction misses; 1 for None."""
    if predicted is None:
        return 1.0
    _require_same_shape(predicted, truth)
    return int((truth & ~predicted).sum()) / int(truth.sum())


def _outside(predicted: Mask, truth: Mask, *, near: bool) -> float:
    _require_same_shape(predicted, truth)
    close = _count_around(truth, _band(truth.shape)) > 0
    return int((predicted & ~truth & (close == near)).sum()) / int(truth.sum())


def _require_same_shape(predicted: Mask, truth: Mask) -> None:
    if predicted.shape != truth.shape:
        raise ValueError(f"masks must have one shape, got {predicted.shape} and {truth.shape}")


def feature_agreement(
    features: NDArray[np.floating],
    labels: NDArray[np.integer],
    *,
    alpha: NDArray[np.floating] | None = None,
) -> float:
    """Return how well rendered features reproduce the segments of a label map that they were not trained on.

    The mean feature of each segment selects the pixels whose feature has a cosine of at least `INSTANCE_COSINE` with
    it. They are compared with the segment.

    Parameters
    ----------
    features : array of shape [H, W, D], float
        Rendered features of any length.
    labels : int array of shape [H, W]
        Segments 1, 2, ...; pixels of 0 are ignored.
    alpha : array of shape [H, W], optional
        Pixels of 0.5 or less are not selected.

    Returns
    -------
    float
        Mean intersection over union of the segments, 0 to 1; NaN when none is large enough.
    """
    labelled = labels > 0
    unit, ids = normalized(features[labelled]), labels[labelled]
    covered = np.ones(len(ids), bool) if alpha is None else alpha[labelled] > 0.5
    scores = []
    for segment, count in zip(*np.unique(ids, return_counts=True), strict=True):
        if count < _MIN_AGREEMENT_PIXELS:
            continue
        inside = ids == segment
        mean = unit[inside].mean(axis=0)
        length = float(np.linalg.norm(mean))
        found = (unit @ (mean / max(length, 1e-12)) >= INSTANCE_COSINE) & covered
        scores.append(iou(found, inside))
    return float(np.mean(scores)) if scores else float("nan")
