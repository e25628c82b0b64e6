"""Which object a click or a box means: one of the scene, else for a click what other photos or its own one show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix

from ..core.arrays import Float32, Int64, Mask
from ..core.system import usable_cores
from ..masks import box_ious, mask_box
from .context import SegmentationContext
from .evidence import clicks_by_photo, evidence_of_exclusions, pixel_of
from .graph import SceneGraph, bounded
from .prompts import BoxPrompt, Point, camera_of_prompt
from .proposals import log_odds
from .settings import MEMBER_THRESHOLD
from .votes import MaskEvidence

_MOST = 0.5
"""Share of the pixels of the Gaussians at each clicked place that a segment, or a set, has at least."""

_LARGEST = 4.0  # chosen on banana16, herz_jesus25, meeting_place9, room_1, room_3, room_5, room_7
"""Gaussians that a set may have, relative to what the evidence leads to: a label on a banana is not the bananas."""

_LARGEST_OBJECT = (
    8.0  # chosen on banana16, herz_jesus25, meeting_place9, model_rooms, room_1, room_2, room_3, room_4, room_5, room_6
)
"""Gaussians of an object of the scene, relative to those that the evidence knows: these may be a small part of it."""

_BOX_IOU = 0.7  # chosen on room_1, room_2, room_5
"""IoU of a given box with that of an object in the same photo from which on the object is meant."""

_PLACE = 1
"""Pixels of the view's frame around a clicked one that belong to the place: what a click meets is a few Gaussians."""


def whole_evidence(
    context: SegmentationContext,
    clicks: Sequence[Point],
    evidence: Sequence[MaskEvidence],
    objects: Mask,
) -> list[MaskEvidence] | None:
    """Return the evidence of clicks with the members of the object that holds all clicked places; None for none.

    The segment under a click is often a part: the dial of a clock, the label of a bottle. The object of the scene that
    holds the places is therefore meant, unless it is much larger than what the evidence knows. Excluded evidence stays.

    Parameters
    ----------
    evidence : sequence of MaskEvidence
        That of `evidence_of_clicks`.
    objects : array of shape [K, N], bool
        The Gaussians of the objects of the scene (`choosing.objects_of`); K may be 0.
    """
    shown = [item for item in evidence if not item.excluded]
    held = _shares(objects, np.hstack(_pixels_at(context, clicks))).min(axis=1)
    if known := [item.members.sum() for item in shown if item.members is not None]:
        held = held * (objects.sum(axis=1) <= _LARGEST_OBJECT * max(known))
    if held.max(initial=0) < _MOST:
        return None
    members = objects[held.argmax()]
    return [item if item.excluded else _showing(context, item, members) for item in evidence]


def boxed_evidence(context: SegmentationContext, prompt: BoxPrompt, objects: Mask) -> list[MaskEvidence] | None:
    """Return the object of the scene that fills a box in its photo, as evidence; None for none.

    SAM's mask of a box is that of a single photo, often of a part, or of what stands behind as well.

    Parameters
    ----------
    objects : array of shape [K, N], bool
        As of `whole_evidence`.
    """
    view = context.views.of(camera_of_prompt(prompt, context.views.cameras))
    shown = [mask & view.within for mask in context.views.visible_masks(view, objects)]
    box = np.array([prompt.x0, prompt.y0, prompt.x1, prompt.y1], np.float32)
    boxes = np.array([mask_box(view.to_photo(mask)) or (0, 0, 0, 0) for mask in shown], np.float32).reshape(-1, 4)
    fits = box_ious(boxes, box)
    if fits.max(initial=0) < _BOX_IOU:
        return None
    best = int(fits.argmax())
    excluded = evidence_of_exclusions((), prompt.excluded, context)
    return [MaskEvidence(view, shown[best], 1.0, members=objects[best]), *excluded]


def likelier_evidence(
    context: SegmentationContext, clicks: Sequence[Point], evidence: Sequence[MaskEvidence], answer: Mask
) -> list[MaskEvidence]:
    """Return the evidence of clicks, with the members of what is likelier an object than their answer where there is.

    In one photo a segment shows a door alone, in the next one together with its wall. In each photo, the segment that
    shows the clicked Gaussians leads to a set. Of these sets, and of the answer, the likeliest object is meant
    (`proposals.log_odds`, with the outlines of the photos as agreement), unless it is much larger. It holds each
    clicked place.

    Parameters
    ----------
    evidence : sequence of MaskEvidence
        That of `evidence_of_clicks`, none of it excluded.
    answer : array of shape [N], bool
        The Gaussians that the evidence leads to, not empty.
    """
    each = zip(evidence, _pixels_at(context, clicks), strict=True)
    return [_likelier(context, item, answer, weights) for item, weights in each]


def _pixels_at(context: SegmentationContext, clicks: Sequence[Point]) -> list[Float32]:
    """Return for each clicked photo the pixels of the Gaussians at each of its S places, [N, S]."""
    result = []
    for view, spots in clicks_by_photo(clicks, context):
        shown = np.zeros((*view.within.shape, len(spots)), np.float32)
        for number, (x, y) in enumerate(spots):
            column, row = pixel_of(view, x, y)
            rows, columns = (slice(max(at - _PLACE, 0), at + _PLACE + 1) for at in (row, column))
            shown[rows, columns, number] = 1
        result.append(context.views.scene.votes(view.frame, shown))
    return result


def _shares(sets: Mask, weights: Float32) -> Float32:
    """Return the share of the pixels at S places, [N, S], that each of K sets, [K, N], has, [K, S]."""
    return np.asarray(sets @ weights / np.maximum(weights.sum(axis=0), np.finfo(np.float32).tiny), np.float32)


def _showing(context: SegmentationContext, item: MaskEvidence, members: Mask) -> MaskEvidence:
    """Return the evidence of a click with these members, [N]."""
    return replace(item, mask=context.views.visible(item.view, members) & item.view.within, members=members)


def _likelier(context: SegmentationContext, item: MaskEvidence, answer: Mask, weights: Float32) -> MaskEvidence:
    """Return the evidence with the members of the likeliest object that holds the Gaussians of each place, [N, S]."""
    graph = context.graph
    segments = _segments_at(graph, weights)
    strictness = context.settings.strictness
    solved = graph.memberships(graph.votes_of(segments), strictness, n_threads=len(usable_cores()))
    members = np.stack([answer, *(bounded(one, context.means) >= MEMBER_THRESHOLD for one in solved)])
    sizes = members.sum(axis=1)
    possible = (sizes > 0) & (sizes <= _LARGEST * sizes[0]) & (_shares(members, weights) >= _MOST).all(axis=1)
    possible[0] = True
    members = members[possible]
    sets = csr_matrix(members, dtype=np.float32)
    best = int(log_odds(context, sets, graph.outline_agreement(sets)).argmax())
    return item if best == 0 else _showing(context, item, members[best])


def _segments_at(graph: SceneGraph, weights: Float32) -> Int64:
    """Return the segment of each photo that shows most of the Gaussians, if it shows `_MOST` of those of each place.

    Parameters
    ----------
    weights : array of shape [N, S], float32
        Pixels of the Gaussians at each of S places.
    """
    parts = weights / np.maximum(np.asarray(graph.segments.sum(axis=1)), 1)
    of_segments = np.asarray(graph.segments.T @ parts)
    found = []
    for photo in range(len(graph.photos)):
        here = graph.photo == photo
        columns, of_photo = np.flatnonzero(here & graph.is_segment), of_segments[here].sum(axis=0)
        if len(columns) and of_photo.any():
            best = columns[of_segments[columns].sum(axis=1).argmax()]
            if (of_segments[best] >= _MOST * of_photo).all():
                found.append(best)
    return np.array(found, np.int64)
