"""Segment Anything's own generator (Kirillov et al. 2023, appendix B): a grid of clicks, judged, thinned out by boxes.

One pass over the whole photo, without its crops. Asked for by the presets ``published`` and ``paper`` of
`MaskSettings`; with 1,024 clicks a photo it takes many times as long as `engine.masks.automatic`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled
from ..events import StopCheck
from .sam import Embedding, SegmentAnything, photo_logits
from .settings import MaskSettings

__all__ = ["STOPPED", "masks_of_grid", "stability"]

Mask = NDArray[np.bool_]

STOPPED = "Stopped while cutting a photo into segments; the photos done before are kept."


def masks_of_grid(
    embedding: Embedding,
    sam: SegmentAnything,
    settings: MaskSettings,
    size: tuple[int, int],
    *,
    should_stop: StopCheck,
) -> list[Mask]:
    """Return the masks of a photo, the one whose predicted IoU is highest first.

    Parameters
    ----------
    embedding : Embedding
    sam : SegmentAnything
    settings : MaskSettings
        ``grid`` clicks along each side; `max_overlap` is of the masks' bounding boxes.
    size : (int, int)
        Height and width of the masks.
    should_stop : StopCheck
        Asked before every click.

    Raises
    ------
    Cancelled
        When `should_stop` says so.
    """
    masks: list[Mask] = []
    scores: list[float] = []
    for point in _grid(embedding, settings.grid):
        if should_stop():
            raise Cancelled(STOPPED)
        scales = sam.predict_scales(embedding, [point], [1])
        for low, iou in scales[-1:] if settings.scales == "whole" else scales:
            if iou <= settings.min_iou:
                continue
            logits = photo_logits(low, embedding, *size)
            mask = logits > 0
            if mask.any() and stability(logits) > settings.min_stability:
                masks.append(mask)
                scores.append(iou)
    boxes = np.array([_box(mask) for mask in masks], np.int64).reshape(-1, 4)
    return [masks[i] for i in _kept(boxes, np.array(scores), settings.max_overlap)]


def stability(logits: NDArray[np.float32]) -> float:
    """Return the IoU of a mask at logit +1 with the one at -1: the former lies inside, so the ratio of their areas."""
    return float(np.count_nonzero(logits > 1)) / max(1.0, float(np.count_nonzero(logits > -1)))


def _grid(embedding: Embedding, along: int) -> list[tuple[float, float]]:
    """Return x, y of ``along`` x ``along`` clicks, row by row.

    Meta counts pixels from their corners, and its decoder adds half a pixel of the encoder's frame.
    """
    half = 0.5 / embedding.scale
    shares = [(i + 0.5) / along for i in range(along)]
    return [(x * embedding.width + half, y * embedding.height + half) for y in shares for x in shares]


def _box(mask: Mask) -> tuple[int, int, int, int]:
    """Return the first and last column and row, x0, y0, x1, y1, as Meta's generator takes them."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(columns[0]), int(rows[0]), int(columns[-1]), int(rows[-1])


def _kept(boxes: NDArray[np.int64], scores: NDArray[np.float64], max_overlap: float) -> list[int]:
    """Return which boxes stay, best first: each drops those behind it whose IoU with it is above `max_overlap`."""
    kept: list[int] = []
    order = np.argsort(-scores, kind="stable")
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    while len(order):
        best, order = int(order[0]), order[1:]
        kept.append(best)
        low = np.maximum(boxes[best, :2], boxes[order, :2])
        high = np.minimum(boxes[best, 2:], boxes[order, 2:])
        shared = np.prod(np.maximum(high - low, 0), axis=1)
        union = areas[best] + areas[order] - shared
        order = order[shared <= max_overlap * union]
    return kept
