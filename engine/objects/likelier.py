"""What a click means: what its own photo shows there, or what other photos show there and is likelier an object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix

from ..core.arrays import Float32, Int64, Mask
from ..core.system import usable_cores
from .context import SegmentationContext
from .evidence import clicks_by_photo, pixel_of
from .graph import SceneGraph, bounded
from .prompts import Point
from .proposals import log_odds
from .settings import MEMBER_THRESHOLD
from .votes import MaskEvidence

_MOST = 0.5
"""Share of the pixels of the Gaussians at each clicked place that a segment, or a set, has at least."""

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
    (`proposals.log_odds`, with the outlines of the photos as agreement), unless it is much larger. It holds each
    clicked place.

    Parameters
    ----------
    evidence : sequence of MaskEvidence
        That of `evidence_of_clicks`, none of it excluded.
    answer : array of shape [N], bool
        The Gaussians that the evidence leads to, not empty.
    """
    places = {view.camera.photo: (view, spots) for view, spots in clicks_by_photo(clicks, context)}
    result = []
    for item in evidence:
        view, spots = places[item.view.camera.photo]
        places_shown = np.zeros((*view.within.shape, len(spots)), np.float32)
        for number, (x, y) in enumerate(spots):
            column, row = pixel_of(view, x, y)
            rows, columns = (slice(max(at - _PLACE, 0), at + _PLACE + 1) for at in (row, column))
            places_shown[rows, columns, number] = 1
        result.append(_likelier(context, item, answer, context.views.scene.votes(view.frame, places_shown)))
    return result


def _likelier(context: SegmentationContext, item: MaskEvidence, answer: Mask, weights: Float32) -> MaskEvidence:
    """Return the evidence with the members of the likeliest object that holds the Gaussians of each place, [N, S]."""
    graph, views = context.graph, context.views
    segments = _segments_at(graph, weights)
    strictness = context.settings.strictness
    solved = graph.memberships(graph.votes_of(segments), strictness, n_threads=len(usable_cores()))
    members = np.stack([answer, *(bounded(one, context.means) >= MEMBER_THRESHOLD for one in solved)])
    sizes = members.sum(axis=1)
    possible = (
        (sizes > 0) & (sizes <= _LARGEST * sizes[0]) & (members @ weights >= _MOST * weights.sum(axis=0)).all(axis=1)
    )
    possible[0] = True
    members = members[possible]
    sets = csr_matrix(members, dtype=np.float32)
    best = int(log_odds(context, sets, graph.outline_agreement(sets)).argmax())
    if best == 0:
        return item
    return replace(item, mask=views.visible(item.view, members[best]) & item.view.within, members=members[best])


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
