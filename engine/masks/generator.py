"""Segment Anything's published mask generator (Kirillov et al. 2023, appendix B).

Masks of a grid of clicks are filtered by predicted IoU and stability, then by non-maximum suppression of their bounding
boxes. One pass over the whole photo, without the crops of the original. The presets ``published`` and ``paper`` of
`MaskSettings` use it; with 1,024 clicks per photo it is many times slower than `engine.masks.automatic`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Mask
from ..core.errors import Cancelled
from ..core.events import StopCheck
from .mask_geometry import mask_box, suppress_overlapping
from .sam import Embedding, SegmentAnything, photo_logits
from .settings import MaskSettings

CANCELLED_MESSAGE = "Stopped while segmenting a photo; the label maps of earlier photos are kept."


def generate_grid_masks(
    embedding: Embedding,
    sam: SegmentAnything,
    settings: MaskSettings,
    size: tuple[int, int],
    *,
    should_stop: StopCheck,
) -> list[Mask]:
    """Return the masks of a photo, sorted by predicted IoU, highest first.

    Parameters
    ----------
    settings : MaskSettings
        ``grid`` clicks along each side; `max_overlap` applies to the bounding boxes of the masks.
    size : (int, int)
        Height and width of the masks.
    should_stop : StopCheck
        Called before each click.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """
    masks: list[Mask] = []
    scores: list[float] = []
    for point in _grid(embedding, settings.grid):
        if should_stop():
            raise Cancelled(CANCELLED_MESSAGE)
        scales = sam.predict_scales(embedding, [point], [1])
        for low, iou in scales[-1:] if settings.scales == "whole" else scales:
            if iou <= settings.min_iou:
                continue
            logits = photo_logits(low, embedding, *size)
            mask = logits > 0
            if mask.any() and stability_score(logits) > settings.min_stability:
                masks.append(mask)
                scores.append(iou)
    boxes = np.array([_inclusive_box(mask) for mask in masks], np.int64).reshape(-1, 4)
    return [masks[i] for i in suppress_overlapping(boxes, scores, settings.max_overlap)]


def stability_score(logits: NDArray[np.float32]) -> float:
    """Return the IoU of the masks at logit thresholds +1 and -1, which is the ratio of their areas."""
    return float(np.count_nonzero(logits > 1)) / max(1.0, float(np.count_nonzero(logits > -1)))


def _grid(embedding: Embedding, n_cells: int) -> list[tuple[float, float]]:
    """Return x, y of ``n_cells`` x ``n_cells`` clicks, row by row.

    In Meta's generator a pixel's coordinates refer to its corner, and its decoder adds half a pixel of the
    encoder's frame. The half pixel added here gives the same positions.
    """
    half = 0.5 / embedding.scale
    fractions = [(i + 0.5) / n_cells for i in range(n_cells)]
    return [(x * embedding.width + half, y * embedding.height + half) for y in fractions for x in fractions]


def _inclusive_box(mask: Mask) -> tuple[int, int, int, int]:
    """Return the first and last column and row, x0, y0, x1, y1, the convention of Meta's generator."""
    box = mask_box(mask)
    assert box is not None, "empty masks were dropped before"
    x0, y0, x1, y1 = box
    return x0, y0, x1 - 1, y1 - 1
