"""Cuts a whole photo into segments: clicks where nothing is found yet, judged, thinned out, painted by size.

Segment Anything's own generator asks 1,024 times a photo; with one mask a call that is a minute and more on a
CPU. Here each click goes to the middle of the largest area that no mask covers, so that some 40 are enough. Where the
decoder gives part, object and whole for a click, each is judged by itself. The generator as published is there too, for
comparison (`engine.masks.generator`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled
from ..events import StopCheck, never_stop
from .generator import STOPPED, masks_of_grid, stability
from .sam import INPUT_SIDE, LOW_RES_SIDE, Embedding, SegmentAnything, photo_logits
from .settings import MaskSettings

__all__ = ["label_map_size", "paint_labels", "segment_everything"]

Mask = NDArray[np.bool_]

# A click that brought nothing new is not repeated nearer than this many low-resolution pixels (of 256).
_TRIED_RADIUS = 6
# Areas whose largest inner circle has a smaller radius (low-resolution pixels) are seams between masks.
_SMALLEST_RADIUS = 2.5


@dataclass
class _Candidate:
    logits: NDArray[np.float32]
    mask: Mask
    iou: float


def label_map_size(height: int, width: int, max_side: int) -> tuple[int, int]:
    """Return height and width of the label map of a photo: its own size, at most `max_side` long."""
    scale = min(1.0, max_side / max(height, width))
    return max(1, round(height * scale)), max(1, round(width * scale))


def segment_everything(
    embedding: Embedding,
    sam: SegmentAnything,
    settings: MaskSettings | None = None,
    *,
    should_stop: StopCheck = never_stop,
) -> NDArray[np.int32]:
    """Return the label map of a photo.

    Parameters
    ----------
    embedding : Embedding
        The photo as `SegmentAnything.encode` gives it.
    sam : SegmentAnything
    settings : MaskSettings or None
        None takes the defaults.
    should_stop : StopCheck
        Asked before every click.

    Returns
    -------
    array of shape [h, w], int32
        0 where no segment is, ids 1, 2, ... without gaps, in the order of ``settings.painting``; h, w is the photo's
        frame scaled so that its longest side is at most ``settings.max_side``.

    Raises
    ------
    Cancelled
        When `should_stop` says so.
    """
    settings = settings or MaskSettings()
    height, width = label_map_size(embedding.height, embedding.width, settings.max_side)
    size = (height, width)
    if settings.generator == "published":
        masks = masks_of_grid(embedding, sam, settings, size, should_stop=should_stop)
    else:
        found = _search(embedding, sam, settings, min_area=settings.min_area, size=size, should_stop=should_stop)
        masks = [photo_logits(candidate.logits, embedding, height, width) > 0 for candidate in found]
    return paint_labels(masks, size, min_area=settings.min_area, painting=settings.painting)


def _search(
    embedding: Embedding,
    sam: SegmentAnything,
    settings: MaskSettings,
    *,
    min_area: int,
    size: tuple[int, int],
    should_stop: StopCheck,
) -> list[_Candidate]:
    """Click until nothing is left to click on, all in the low-resolution frame, which costs next to nothing."""
    # The part of the padded 256 x 256 square that the photo covers.
    rows = max(1, round(embedding.height * embedding.scale * LOW_RES_SIDE / INPUT_SIDE))
    columns = max(1, round(embedding.width * embedding.scale * LOW_RES_SIDE / INPUT_SIDE))
    smallest = min_area * rows * columns / (size[0] * size[1])
    found: list[_Candidate] = []
    tried = np.zeros((rows, columns), np.uint8)
    grid = _grid(rows, columns, settings.grid)
    for _ in range(settings.max_prompts):
        if should_stop():
            raise Cancelled(STOPPED)
        click = _next_click(found, tried, grid, settings)
        if click is None:
            break
        cv2.circle(tried, click, _TRIED_RADIUS, 1, -1)
        point = (np.array(click) + 0.5) * (embedding.width / columns, embedding.height / rows)
        for logits, iou in sam.predict_scales(embedding, [point], [1]):
            candidate = _Candidate(logits, logits[:rows, :columns] > 0, iou)
            if _is_good(candidate, logits[:rows, :columns], settings, smallest):
                _admit(candidate, found, settings.max_overlap)
    return found


def _grid(rows: int, columns: int, along: int) -> list[tuple[int, int]]:
    """Cell centres x, y of a grid with `along` cells on the longest side, those near the middle first."""
    if along == 0:
        return []
    cell = max(rows, columns) / along
    across, down = max(1, round(columns / cell)), max(1, round(rows / cell))
    points = [
        (int((i + 0.5) * columns / across), int((j + 0.5) * rows / down)) for j in range(down) for i in range(across)
    ]
    return sorted(points, key=lambda p: (p[0] - columns / 2) ** 2 + (p[1] - rows / 2) ** 2)


def _next_click(
    found: list[_Candidate], tried: NDArray[np.uint8], grid: list[tuple[int, int]], settings: MaskSettings
) -> tuple[int, int] | None:
    """Return x, y of the next click: the middle of the widest uncovered area, after it the coarse grid."""
    free = (1 - tried).astype(np.uint8)
    for candidate in found:
        free[candidate.mask] = 0
    # A border of zeros makes the edge of the frame count as covered, so clicks keep off it.
    distance = cv2.distanceTransform(np.pad(free, 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
    best = int(np.argmax(distance))
    if distance.flat[best] >= _SMALLEST_RADIUS:
        return best % free.shape[1], best // free.shape[1]
    large = settings.large_fraction * free.size
    small = np.zeros(free.shape, bool)
    for candidate in found:
        if np.count_nonzero(candidate.mask) <= large:
            small |= candidate.mask
    while grid:
        x, y = grid.pop(0)
        if not small[y, x] and not tried[y, x]:
            return x, y
    return None


def _is_good(candidate: _Candidate, logits: NDArray[np.float32], settings: MaskSettings, smallest: float) -> bool:
    area = np.count_nonzero(candidate.mask)
    if area < smallest or area > settings.max_frame_fraction * candidate.mask.size:
        return False
    if candidate.iou < settings.min_iou:
        return False
    return stability(logits) >= settings.min_stability


def _admit(candidate: _Candidate, found: list[_Candidate], max_overlap: float) -> None:
    """Add `candidate` unless a better mask of the same thing is there; those it betters go."""
    rivals = [other for other in found if _iou(candidate.mask, other.mask) > max_overlap]
    if any(other.iou >= candidate.iou for other in rivals):
        return
    found[:] = [other for other in found if not any(other is rival for rival in rivals)]
    found.append(candidate)


def _iou(a: Mask, b: Mask) -> float:
    union = np.count_nonzero(a | b)
    return np.count_nonzero(a & b) / union if union else 0.0


def paint_labels(
    masks: list[Mask], size: tuple[int, int], *, min_area: int, painting: Literal["size", "score"] = "size"
) -> NDArray[np.int32]:
    """Return one label map from masks that may overlap: large ones below, small ones on top.

    Parameters
    ----------
    masks : list of arrays of shape [h, w], bool
    size : (int, int)
        h, w.
    min_area : int
        Islands of a segment that have fewer pixels are unlabelled, holes are filled.
    painting : {"size", "score"}
        ``score`` paints them in the order given instead.

    Returns
    -------
    array of shape [h, w], int32
        Ids 1, 2, ... without gaps, in order of painting.
    """
    labels = np.zeros(size, np.int32)
    order = sorted(masks, key=np.count_nonzero, reverse=True) if painting == "size" else masks
    for number, mask in enumerate(order, start=1):
        labels[_cleaned(mask, min_area)] = number
    clean = np.zeros(size, np.int32)
    number = 0
    for old in range(1, len(masks) + 1):
        # Once more: what lies on top may have cut a segment into islands.
        visible = _without_islands(labels == old, min_area)
        if visible.any():
            number += 1
            clean[visible] = number
    return clean


def _cleaned(mask: Mask, min_area: int) -> Mask:
    return ~_without_islands(~_without_islands(mask, min_area), min_area)


def _without_islands(mask: Mask, min_area: int) -> Mask:
    _, components, statistics, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    keep = statistics[:, cv2.CC_STAT_AREA] >= min_area
    keep[0] = False
    return np.asarray(keep[components])
