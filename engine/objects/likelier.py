"""What a click means: what its own photo shows there, or what other photos show there and is likelier an object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix

from ..core.arrays import Float32, Int64, Mask
from .context import SegmentationContext
from .evidence import clicks_by_photo, pixel_of
from .graph import SceneGraph, bounded
from .prompts import Point
from .proposals import log_odds
from .settings import MEMBER_THRESHOLD
from .votes import MaskEvidence

_MOST = 0.5
"""Share of the pixels of the clicked Gaussians that a segment, or a set, has at least."""

_LARGEST = 4.0  # chosen on banana16, herz_jesus25, meeting_place9, room_1, room_3, room_5, room_7
"""Gaussians that a set may have, relative to what the evidence leads to: a label on a banana is not the bananas."""

_PLACE = 1
"""Pixels of the view's frame around a clicked one that belong to the place: what a click meets is a few Gaussians."""


def likelier_evidence(
    context: SegmentationContext, clicks: Sequence[Point], evidence: Sequence[MaskEvidence], answer: Mask
) -> list[MaskEvidence]:
    """Return the evidence of clicks, with the members of what is likelier an object than their answer where there is.

    In one photo a segment shows a door alone, in the next one together with its wall. In each photo, the segment that
    shows the clicked Gaussians leads to a set. Of these sets, and of the answer, the likeliest object is meant
    (`proposals.log_odds`), unless it is much larger.

    Parameters
    ----------
    evidence : sequence of MaskEvidence
        That of `evidence_of_clicks`; what is excluded stays.
    answer : array of shape [N], bool
        The Gaussians that the evidence leads to, not empty.
    """
    places = {view.camera.photo: (view, spots) for view, spots in clicks_by_photo(clicks, context)}
    result = []
    for item in evidence:
        if item.excluded:
            result.append(item)
            continue
        view, spots = places[item.view.camera.photo]
        place = np.zeros(view.within.shape, np.float32)
        for x, y in spots:
            column, row = pixel_of(view, x, y)
            place[max(row - _PLACE, 0) : row + _PLACE + 1, max(column - _PLACE, 0) : column + _PLACE + 1] = 1
        weights = context.views.scene.votes(view.frame, place[..., None])[:, 0]
        result.append(_likelier(context, item, answer, weights))
    return result


def _likelier(context: SegmentationContext, item: MaskEvidence, answer: Mask, weights: Float32) -> MaskEvidence:
    """Return the evidence with the members of the likeliest object of those that hold the clicked Gaussians."""
    graph, views = context.graph, context.views
    segments = _segments_at(graph, weights)
    solved = graph.memberships(graph.votes_of(segments), context.settings.strictness)
    members = np.stack([answer, *(bounded(one, context.means) >= MEMBER_THRESHOLD for one in solved)])
    sizes = members.sum(axis=1)
    possible = (sizes > 0) & (sizes <= _LARGEST * sizes[0]) & (members @ weights >= _MOST * weights.sum())
    possible[0] = True
    members = members[possible]
    sets = csr_matrix(members, dtype=np.float32)
    best = int(log_odds(context, sets, graph.outline_agreement(sets)).argmax())
    if best == 0:
        return item
    return replace(item, mask=views.visible(item.view, members[best]) & item.view.within, members=members[best])


def _segments_at(graph: SceneGraph, weights: Float32) -> Int64:
    """Return the segment of each photo that shows most of the Gaussians, [N] pixels, if it shows `_MOST` of them."""
    parts = weights / np.maximum(np.asarray(graph.segments.sum(axis=1)).ravel(), 1)
    of_segments = np.asarray(graph.segments.T @ parts).ravel()
    of_photos = np.bincount(graph.photo, of_segments, len(graph.photos))
    found = []
    for photo in np.flatnonzero(of_photos > 0):
        columns = np.flatnonzero((graph.photo == photo) & graph.is_segment)
        if len(columns):
            best = columns[of_segments[columns].argmax()]
            if of_segments[best] >= _MOST * of_photos[photo]:
                found.append(best)
    return np.array(found, np.int64)
