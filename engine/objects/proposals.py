"""Proposals: sets of Gaussians that may be objects, from the segments of the photos and from groups of the scene.

Five measurements say how likely a set is an object, and in `looks` how it looks; see docs/objects.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix, vstack
from scipy.special import expit, logit

from ..core.arrays import Float32, Float64, Floats, Int32, Int64, Mask
from ..core.system import usable_cores
from .context import SegmentationContext
from .found import MAX_COMMON
from .graph import LARGE, SceneGraph, bounded
from .groups import build_groups
from .settings import MEMBER_THRESHOLD
from .views import MIN_VISIBLE_PIXELS, SAME_IOU
from .votes import Votes, votes_of_known

_SETS_TOGETHER = 16
"""Sets of Gaussians that are solved together. More need more memory and are hardly faster."""

_ALIKE_IOU = 0.75  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""IoU above which two proposals look alike."""

_USUAL_EXTENT = 0.12  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8, more_rooms
"""Extent (`Views.extent`) of a usual object."""

_SHAPE_WEIGHT = 2.0  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Weight of how a set stands, of what the photos say and of its extent, in the log-odds of being an object. Fitted were
1.96, 2.48 and 1.47."""

_ISOLATION_WEIGHT = 0.5  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Weight of the isolation and the share of a set in these log-odds, fitted were 0.54 and 0.74."""

_USUAL_SHAPE = 1.0  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Sum of the measurements with `_SHAPE_WEIGHT` that says nothing for or against an object."""

LEAST_PROBABILITY = 0.25  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8, more_rooms
"""Probability from which on a set may be an object, before and after it was looked at."""


@dataclass(frozen=True)
class Proposals:
    """K sets of Gaussians that may be objects, in a scene with P photos in its graph.

    Attributes
    ----------
    members : array of shape [K, N], bool
        Sets may overlap: a part and its whole are two proposals.
    odds : array of shape [K], float32
        Log-odds of being an object, in descending order.
    like : array of shape [K], int32
        Number of a likelier proposal that looks the same, or of the proposal itself.
    shown : array of shape [K, P], float32
        Pixels that show each set in each photo.
    """

    members: Mask
    odds: Float32
    like: Int32
    shown: Float32


def find_proposals(context: SegmentationContext) -> Proposals:
    """Return each segment of each photo, and each group, solved like a mask.

    With the weights of the links between Gaussians that leave a set, of all links of the set (or of the rest, if they
    are less) and of the leaving ones times the height at which they leave, its share of the Gaussians, its extent, and,
    for each photo that shows it well, the IoU of the set with the solved segment of the photo that fits it best, the
    log-odds of being an object are

        (ln(links / leaving) + ln(share)) / 2 + 2 (ln(leaving / rising) + mean IoU - ln(extent / 0.12)^2 - 1)

    Raises
    ------
    Cancelled
        When the user stops.
    """
    graph = context.graph
    pixels = np.asarray(graph.segments.sum(axis=0)).ravel()
    segments = np.flatnonzero((pixels >= MIN_VISIBLE_PIXELS) & graph.is_segment)
    # One thread groups while others solve segments.
    with ThreadPoolExecutor(1) as beside:
        solved, kept = _solved(context, segments, beside.submit(build_groups, context.views))
    of_segments = kept < len(segments)
    shown = graph.shown(solved)
    best = graph.iou(solved, solved[of_segments])
    agreement = _agreement(best, graph.photo[segments[kept[of_segments]]], shown)
    odds = log_odds(context, solved, agreement)
    likely = np.flatnonzero((odds >= logit(LEAST_PROBABILITY)) & (shown.max(axis=1, initial=0) > 0))
    likely = likely[np.argsort(-agreement[likely], kind="stable")]
    first = _first_alike(graph.iou(solved[likely], solved[likely]), SAME_IOU)
    chosen = likely[first == np.arange(len(likely))]
    chosen = chosen[np.argsort(-odds[chosen], kind="stable")]
    sets = solved[chosen]
    like = _first_alike(graph.iou(sets, sets), _ALIKE_IOU)
    return Proposals(sets.toarray() > 0, odds[chosen].astype(np.float32), like, shown[chosen])


def log_odds(context: SegmentationContext, sets: csr_matrix, agreement: Floats) -> Float64:
    """Return the log-odds of being an object of K sets, [K, N], none of them empty.

    Parameters
    ----------
    agreement : array of shape [K], float
        How well photos outline each set: the mean IoU of `find_proposals`, or `SceneGraph.outline_agreement`.
    """
    extents = np.array([context.views.extent(row.toarray().ravel() > 0) for row in sets])
    unusual = np.log(np.maximum(extents, np.finfo(np.float32).tiny) / _USUAL_EXTENT) ** 2
    share = np.log(np.asarray(sets.mean(axis=1)).ravel())
    isolation, standing = _isolation(sets, context.graph, context.means[:, 2])  # Z is up
    odds = _ISOLATION_WEIGHT * (isolation + share) + _SHAPE_WEIGHT * (standing + agreement - unusual - _USUAL_SHAPE)
    return np.asarray(odds, np.float64)


def gains_of(odds: Floats) -> Floats:
    """Return what choosing each of K sets is worth by its log-odds of being an object, [K].

    It is the square of the probability, less that of `LEAST_PROBABILITY`: with the probability alone, two halves, each
    of them less likely than their whole, would often be worth more together.
    """
    return np.asarray(expit(odds) ** 2 - LEAST_PROBABILITY**2)


def choose_sets(members: Mask, gains: Floats) -> list[int]:
    """Return which sets to choose for a large sum of gains.

    No two overlap by more than `MAX_COMMON` of the smaller one. The largest gains are chosen first; then a set is
    exchanged for several others, or several for one, for as long as that makes the sum larger.

    Parameters
    ----------
    members : array of shape [K, N], bool
    gains : array of shape [K], float

    Returns
    -------
    list of int
        Numbers of sets with a gain above 0, the best first.
    """
    sets = csr_matrix(members, dtype=np.float32)
    sizes = np.asarray(sets.sum(axis=1)).ravel()
    conflict = (sets @ sets.T).toarray() > MAX_COMMON * np.minimum(sizes[:, None], sizes)
    order = [int(number) for number in np.argsort(-gains, kind="stable") if gains[number] > 0]

    def filled(chosen: list[int], without: Sequence[int] = ()) -> list[int]:
        for number in order:
            if number not in without and number not in chosen and not conflict[number, chosen].any():
                chosen = [*chosen, number]
        return chosen

    def exchanged(chosen: list[int]) -> Iterator[list[int]]:
        for number in chosen:
            yield filled([other for other in chosen if other != number], without=[number])
        for number in order:
            yield [number, *(other for other in chosen if not conflict[number, other])]

    chosen: list[int] = []
    better = filled([])
    while gains[better].sum() > gains[chosen].sum():
        chosen = better
        better = next((one for one in exchanged(chosen) if gains[one].sum() > gains[chosen].sum()), chosen)
    return sorted(chosen, key=lambda number: -gains[number])


def _first_alike(iou: Float32, least: float) -> Int32:
    """Return for each of K sets the first one before it that stands for itself and is like it, or itself, [K]."""
    first = np.arange(len(iou), dtype=np.int32)
    for k in range(len(iou)):
        alike = np.flatnonzero((iou[k, :k] > least) & (first[:k] == np.arange(k)))
        first[k] = alike[0] if len(alike) else k
    return first


def _solved(context: SegmentationContext, segments: Int64, grouping: Future[Mask]) -> tuple[csr_matrix, Int64]:
    """Return the Gaussians that segments and groups lead to, [K, N], without empty sets, and the number of each."""
    graph, passed = context.graph, len(segments)

    def solved(start: int, groups: Mask) -> csr_matrix:
        context.check_stop()
        stop = start + _SETS_TOGETHER
        together = groups[max(0, start - passed) : max(0, stop - passed)].T
        votes = (graph.votes_of(segments[start:stop]), votes_of_known(together, graph.pixels[:, None]))
        both = Votes(np.hstack([one.inside for one in votes]), np.hstack([one.outside for one in votes]))
        memberships = graph.memberships(both, context.settings.strictness)
        members = np.stack([bounded(membership, context.means) for membership in memberships]) >= MEMBER_THRESHOLD
        return csr_matrix(members, dtype=np.float32)

    rows = [csr_matrix((0, len(context.means)), dtype=np.float32)]
    # NumPy and SciPy leave the interpreter to the other threads while they compute.
    with ThreadPoolExecutor(len(usable_cores())) as pool:
        whole, nothing = passed - passed % _SETS_TOGETHER, np.zeros((0, len(context.means)), bool)
        begun = [pool.submit(solved, start, nothing) for start in range(0, whole, _SETS_TOGETHER)]
        try:
            groups = grouping.result()
            count = passed + len(groups)
            begun += [pool.submit(solved, start, groups) for start in range(whole, count, _SETS_TOGETHER)]
            for part in begun:
                rows.append(part.result())
                context.tell(min((len(rows) - 1) * _SETS_TOGETHER / count, 1), "Looking for objects")
        finally:
            for part in begun:
                part.cancel()  # what has not begun when the user stops
    sets = csr_matrix(vstack(rows))
    kept = np.flatnonzero(np.asarray(sets.sum(axis=1)).ravel())
    return sets[kept], kept


def _isolation(sets: csr_matrix, graph: SceneGraph, heights: Floats) -> tuple[Float64, Float64]:
    """Return ln(links / leaving) and ln(leaving / rising) of each set, [K] both, with the links of one more Gaussian.

    They are sums of the weights of links. The first is the negative logarithm of the conductance: links are those of
    the set or of the rest, whichever are less. In the second, each leaving link counts by the height of the member that
    it leaves, from 0 for the lowest to 1 for the highest: an object leaves its surroundings at its foot, a part of an
    object anywhere. `heights`, [N], are those of the Gaussians.
    """
    degrees = np.asarray(graph.neighbours.sum(axis=1)).ravel()
    usual = degrees.mean()
    every = sets @ degrees
    fewer = np.minimum(every, degrees.sum() - every)
    leaving = csr_matrix(sets.multiply(degrees) - (sets @ graph.neighbours).multiply(sets))
    rising = leaving.multiply(_relative_heights(sets, heights))
    all_leaving, all_rising = (np.asarray(links.sum(axis=1), np.float64).ravel() + usual for links in (leaving, rising))
    return np.log((fewer + usual) / all_leaving), np.log(all_leaving / all_rising)


def _relative_heights(sets: csr_matrix, heights: Floats) -> csr_matrix:
    """Return the height of each member of K sets, none empty, 0 for the lowest to 1 for the highest, [K, N].

    In a flat set, all are the highest: it leaves its surroundings everywhere.
    """
    of_members, starts, sizes = heights[sets.indices], sets.indptr[:-1], np.diff(sets.indptr)
    highest = np.maximum.reduceat(of_members, starts)
    span = np.maximum(highest - np.minimum.reduceat(of_members, starts), np.finfo(np.float32).tiny)
    relative = 1 - (np.repeat(highest, sizes) - of_members) / np.repeat(span, sizes)
    return csr_matrix((relative, sets.indices, sets.indptr), shape=sets.shape)


def _agreement(iou: Float32, photo: Int32, shown: Float32) -> Float64:
    """Return the mean over the photos that show a set well, [K]: the IoU with the segment that fits best.

    `iou`, [K, S], are those with what S segments lead to, of the photos `photo`, [S], ascending.
    """
    best = np.zeros(shown.shape)
    first = np.flatnonzero(np.diff(photo, prepend=-1))
    if len(first):
        best[:, photo[first]] = np.maximum.reduceat(iou, first, axis=1)
    seen = shown >= LARGE * shown.max(axis=1, initial=0, keepdims=True)
    return np.asarray((best * seen).sum(axis=1) / np.maximum(seen.sum(axis=1), 1), np.float64)
