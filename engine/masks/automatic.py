"""Segmentation of a whole photo with adaptive clicks.

Segment Anything's published generator uses 1,024 clicks per photo, which takes more than a minute on a CPU. Here each
click is placed at the centre of the largest area that no mask covers yet, so that about 40 clicks are enough. Masks are
filtered by predicted IoU, stability, area and overlap, and painted into one label map in order of size. If the decoder
returns part, object and whole for a click, each of the three masks is filtered separately. The published generator is
available for comparison (`engine.masks.generator`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Mask
from ..core.errors import Cancelled
from ..core.events import StopCheck, never_stop
from .generator import CANCELLED_MESSAGE, generate_grid_masks, stability_score
from .mask_geometry import mask_box, mask_iou
from .sam import INPUT_SIDE, LOW_RES_SIDE, Embedding, SegmentAnything, photo_logits
from .settings import MaskSettings

# No two clicks are closer than this many low-resolution pixels (of 256).
_MIN_CLICK_DISTANCE = 6
# Uncovered areas whose largest inscribed circle has a smaller radius (low-resolution pixels) are gaps between masks.
_MIN_FREE_RADIUS = 2.5
# Points of the coarse grid at which a mask has at least this logit are not clicked: most give that mask again.
_CONFIDENT_LOGIT = 6.0  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8


@dataclass
class _Candidate:
    logits: NDArray[np.float32]
    mask: Mask
    iou: float
    area: int


class _Found:
    """The accepted masks of a photo, and what they leave uncovered."""

    def __init__(self, rows: int, columns: int) -> None:
        self.masks: list[_Candidate] = []
        # Counted, because a mask that is removed uncovers only what no other covers.
        self._n_masks = np.zeros((rows, columns), np.uint16)
        self._padded = np.zeros((rows + 2, columns + 2), np.uint8)

    def admit(self, candidate: _Candidate, max_overlap: float) -> None:
        """Add a mask and remove overlapping ones, unless one of them has at least the same score."""
        rivals = [other for other in self.masks if _overlap(candidate, other, max_overlap)]
        if any(other.iou >= candidate.iou for other in rivals):
            return
        for rival in rivals:
            self._n_masks -= rival.mask
        self._n_masks += candidate.mask
        self.masks = [other for other in self.masks if not any(other is rival for rival in rivals)]
        self.masks.append(candidate)

    def distance_of_free(self, tried: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return for each pixel how far it is from the next one that is covered or was tried."""
        # With a border of zeros, the edge of the frame counts as covered, which keeps clicks away from it.
        np.equal(self._n_masks + tried, 0, out=self._padded[1:-1, 1:-1], casting="unsafe")
        return np.asarray(cv2.distanceTransform(self._padded, cv2.DIST_L2, 3)[1:-1, 1:-1], np.float32)


def label_map_size(height: int, width: int, max_side: int) -> tuple[int, int]:
    """Return height and width of the label map of a photo: the photo's size, reduced to at most `max_side` pixels."""
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
        The embedding of the photo, from `SegmentAnything.encode`.
    settings : MaskSettings or None
        None takes the defaults.
    should_stop : StopCheck
        Called before each click.

    Returns
    -------
    array of shape [h, w], int32
        0 for unlabelled pixels, segment ids 1, 2, ... without gaps in the order of ``settings.painting``. [h, w] is the
        photo's size, reduced so that its longest side is at most ``settings.max_side``.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """
    settings = settings or MaskSettings()
    height, width = label_map_size(embedding.height, embedding.width, settings.max_side)
    size = (height, width)
    if settings.generator == "published":
        masks = generate_grid_masks(embedding, sam, settings, size, should_stop=should_stop)
    else:
        candidates = _search(embedding, sam, settings, min_area=settings.min_area, size=size, should_stop=should_stop)
        masks = [photo_logits(candidate.logits, embedding, height, width) > 0 for candidate in candidates]
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
    """Return the accepted masks of all clicks; works in the low-resolution frame, where one click costs little."""
    # Size of the photo inside the padded square of 256 x 256 pixels.
    rows = max(1, round(embedding.height * embedding.scale * LOW_RES_SIDE / INPUT_SIDE))
    columns = max(1, round(embedding.width * embedding.scale * LOW_RES_SIDE / INPUT_SIDE))
    min_low_res_area = min_area * rows * columns / (size[0] * size[1])
    found = _Found(rows, columns)
    tried = np.zeros((rows, columns), np.uint8)
    grid = _grid(rows, columns, settings.grid)
    for _ in range(settings.max_prompts):
        if should_stop():
            raise Cancelled(CANCELLED_MESSAGE)
        click = _next_click(found, tried, grid, settings)
        if click is None:
            break
        cv2.circle(tried, click, _MIN_CLICK_DISTANCE, 1, -1)
        point = (np.array(click) + 0.5) * (embedding.width / columns, embedding.height / rows)
        for logits, iou in sam.predict_scales(
            embedding, [point], [1], without_padding=True, min_stability=settings.min_stability
        ):
            mask = logits[:rows, :columns] > 0
            candidate = _Candidate(logits, mask, iou, int(np.count_nonzero(mask)))
            if _passes_filters(candidate, logits[:rows, :columns], settings, min_low_res_area):
                found.admit(candidate, settings.max_overlap)
    return found.masks


def _grid(rows: int, columns: int, n_cells: int) -> list[tuple[int, int]]:
    """Return cell centres x, y of a grid with `n_cells` cells on the longest side, those near the centre first."""
    if n_cells == 0:
        return []
    cell = max(rows, columns) / n_cells
    n_columns, n_rows = max(1, round(columns / cell)), max(1, round(rows / cell))
    points = [
        (int((i + 0.5) * columns / n_columns), int((j + 0.5) * rows / n_rows))
        for j in range(n_rows)
        for i in range(n_columns)
    ]
    return sorted(points, key=lambda p: (p[0] - columns / 2) ** 2 + (p[1] - rows / 2) ** 2)


def _next_click(
    found: _Found, tried: NDArray[np.uint8], grid: list[tuple[int, int]], settings: MaskSettings
) -> tuple[int, int] | None:
    """Return x, y of the next click: the centre of the largest uncovered area, then points of the coarse grid."""
    distance = found.distance_of_free(tried)
    best = int(np.argmax(distance))
    if distance.flat[best] >= _MIN_FREE_RADIUS:
        return best % tried.shape[1], best // tried.shape[1]
    small = [candidate for candidate in found.masks if candidate.area <= settings.large_fraction * tried.size]
    while grid:
        x, y = grid.pop(0)
        explained = any(candidate.mask[y, x] for candidate in small)
        confident = any(candidate.logits[y, x] >= _CONFIDENT_LOGIT for candidate in found.masks)
        if not (explained or tried[y, x] or confident):
            return x, y
    return None


def _passes_filters(
    candidate: _Candidate, logits: NDArray[np.float32], settings: MaskSettings, min_area: float
) -> bool:
    if candidate.area < min_area or candidate.area > settings.max_frame_fraction * candidate.mask.size:
        return False
    if candidate.iou < settings.min_iou:
        return False
    return stability_score(logits) >= settings.min_stability


def _overlap(first: _Candidate, second: _Candidate, max_overlap: float) -> bool:
    """Return whether the IoU of two masks is larger than `max_overlap`."""
    smaller, larger = sorted((first.area, second.area))
    # The IoU is at most the ratio of the areas, which costs nothing.
    return smaller / larger > max_overlap and mask_iou(first.mask, second.mask) > max_overlap


def paint_labels(
    masks: list[Mask], size: tuple[int, int], *, min_area: int, painting: Literal["size", "score"] = "size"
) -> NDArray[np.int32]:
    """Return one label map from masks that may overlap; smaller masks are painted over larger ones.

    Parameters
    ----------
    masks : list of arrays of shape [h, w], bool
    size : (int, int)
        h, w.
    min_area : int
        Islands of a segment with fewer pixels become unlabelled, holes with fewer pixels are filled.
    painting : {"size", "score"}
        ``score`` paints the masks in the given order instead.

    Returns
    -------
    array of shape [h, w], int32
        Ids 1, 2, ... without gaps, in the order of painting.
    """
    labels = np.zeros(size, np.int32)
    order = sorted(masks, key=np.count_nonzero, reverse=True) if painting == "size" else masks
    for number, mask in enumerate(order, start=1):
        box = _box(mask, min_area)
        labels[box][_without_islands_and_holes(mask[box], min_area)] = number
    clean = np.zeros(size, np.int32)
    number = 0
    for old, mask in enumerate(order, start=1):
        box = _box(mask, min_area)
        # Islands are removed again, because masks painted later may have divided the segment.
        visible = _without_islands(labels[box] == old, min_area)
        if visible.any():
            number += 1
            clean[box][visible] = number
    return clean


def _box(mask: Mask, min_area: int) -> tuple[slice, slice]:
    """Return rows and columns of the mask's bounding box with a border, in which islands and holes are the same.

    What is outside of the mask must not be taken for a hole: the border has at least `min_area` pixels on each side
    where the picture goes on.
    """
    border = math.isqrt(min_area) + 1
    found = mask_box(mask)
    if found is None:
        return slice(0, 0), slice(0, 0)
    if min(mask.shape) <= border:
        return slice(None), slice(None)
    x0, y0, x1, y1 = found
    return slice(max(0, y0 - border), y1 + border), slice(max(0, x0 - border), x1 + border)


def _without_islands_and_holes(mask: Mask, min_area: int) -> Mask:
    return ~_without_islands(~_without_islands(mask, min_area), min_area)


def _without_islands(mask: Mask, min_area: int) -> Mask:
    if not mask.size:
        return mask
    _, components, statistics, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    keep = statistics[:, cv2.CC_STAT_AREA] >= min_area
    keep[0] = False
    return np.asarray(keep[components])
