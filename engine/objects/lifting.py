"""Lifting: from evidence in views to the Gaussians of an object, by one solve on the graph of the scene."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix

from ..core.arrays import Float32, Float64, Mask
from ..core.errors import PromptError
from ..core.system import usable_cores
from ..masks import mask_iou
from .context import SegmentationContext
from .found import BELOW_THRESHOLD, NONE_BEHIND, NONE_LEFT, FoundObject, Levels, fit_of
from .graph import bounded
from .settings import MEMBER_THRESHOLD
from .support import standing
from .views import SAME_IOU, Views
from .votes import MaskEvidence, Votes, count_votes

_FACTORS = 4.0 ** np.array([2, 1, 0, -1, -2, -3, -4], np.float32)
"""Strictness of each level relative to the settings, from part to whole."""

_USUAL = _FACTORS.tolist().index(1)
"""The level at 1 is the object, unless another one fits what the evidence shows clearly better."""

_AGREEMENT_WEIGHT = (
    0.2  # chosen on skull66, banana16, meeting_place9, herz_jesus25, room_1, room_3, room_5, room_6, room_7, room_8
)
"""Weight of what the segments of the photos say of a level, relative to how well it fits the masks."""

_LEVEL_COST = (
    0.03  # chosen on skull66, banana16, meeting_place9, herz_jesus25, room_1, room_3, room_5, room_6, room_7, room_8
)
"""IoU with the masks that a level must gain for each step from `_USUAL`, and that a foot or a pedestal may cost."""

_FITTING_OUTLINE, _EXACT_OUTLINE = 0.5, 0.75  # chosen on room_1, room_3, room_5, room_7, room_8
"""IoU of a segment with an object from which on it tells what may be its foot, and what is none of its members."""

_LEAST_INSIDE = 0.2  # chosen on room_1, room_3, room_5, room_7, room_8
"""Least share of the pixels of a member that lie inside of these outlines."""

_TOGETHER = 4
"""Objects that are solved together: each step reads the links once for all of them."""

_ONE_LEVEL = np.ones(1, np.float32)
"""Strictness, relative to the settings, where only the object is asked for and no levels."""


def isolate_object(context: SegmentationContext, evidence: Sequence[MaskEvidence]) -> FoundObject:
    """Return the object that all of the evidence shows together.

    It comes with clearly smaller and larger versions: the membership falls as the strictness rises, so that each level
    contains those of higher strictness. The object is the level that fits the masks best.

    Parameters
    ----------
    evidence : sequence of MaskEvidence
        At least one mask is not excluded.

    Raises
    ------
    PromptError
        When no Gaussian lies behind the masks, or the excluded ones leave none.
    Cancelled
        When the user stops.
    """
    context.check_stop()
    shown = sorted((item for item in evidence if not item.excluded), key=lambda item: -item.score)
    most = 1 - _union(context, evidence, _ONE_LEVEL, excluded=True)[0]
    solved = np.minimum(_union(context, evidence, _FACTORS, excluded=False), most)
    # Of known members, the size was chosen already, among sets of all sizes.
    masks = [] if any(item.members is not None for item in shown) else shown
    levels = _nested(context, solved, masks)
    if levels is None:
        raise PromptError(NONE_BEHIND if len(shown) == len(evidence) else NONE_LEFT)
    # What was excluded is no foot either.
    levels = replace(levels, memberships=tuple(np.minimum(one, most) for one in levels.memberships))
    found = FoundObject(levels, shown[0].score, 0.0, tuple(shown))
    return replace(found, fit=fit_of(shown[0], found.members, context.views))


def isolate_proposal(context: SegmentationContext, item: MaskEvidence) -> FoundObject:
    """Return the object of a proposal, whose members are known, with its foot; errors as of `isolate_object`."""
    found = _of_proposal(context, item)
    return replace(found, fit=fit_of(item, found.members, context.views))


def isolate_kept(context: SegmentationContext, item: MaskEvidence, key: str) -> FoundObject:
    """Return the object of a kept proposal as `isolate_proposal` does, without rendering anything.

    Its fit is the IoU with the members in the pixels of all photos of the graph.

    Parameters
    ----------
    item : MaskEvidence
        With its members and which Gaussians are undecided.
    key : str
        Of the graph of the scene.

    Raises
    ------
    PromptError, Cancelled
        As `isolate_object`.
    """
    assert item.members is not None
    context = context.with_kept_graph(key)
    found = _of_proposal(context, item)
    both = (csr_matrix(one[None], dtype=np.float32) for one in (found.members, item.members))
    return replace(found, fit=float(context.graph.iou(*both)[0, 0]))


def _of_proposal(context: SegmentationContext, item: MaskEvidence) -> FoundObject:
    (levels,) = levels_of_each(context, [item])
    if levels is None:
        raise PromptError(NONE_BEHIND)
    return FoundObject(levels, item.score, 0.0, (item,))


def levels_of_each(context: SegmentationContext, evidence: Iterable[MaskEvidence]) -> Iterator[Levels | None]:
    """Yield the levels of the object of each proposal, with its foot; None where no Gaussian belongs to it.

    Several are solved together, which takes less time.

    Raises
    ------
    Cancelled
        When the user stops.
    """
    items = list(evidence)
    for first in range(0, len(items), _TOGETHER):
        context.check_stop()
        for solved in _solved(context, items[first : first + _TOGETHER], _FACTORS):
            yield _nested(context, solved)


def _nested(context: SegmentationContext, solved: Float32, masks: Sequence[MaskEvidence] = ()) -> Levels | None:
    """Return memberships by `_FACTORS`, [7, N], as levels of the object with its foot; None if it is empty.

    `masks` are those that the object has to fit; without any, it is the usual level.
    """
    # Rounding must not let a level leave the next one.
    levels = np.maximum.accumulate([bounded(one, context.means) for one in solved])
    if not (levels[_USUAL] >= MEMBER_THRESHOLD).any():
        return None
    chosen = _fitting(context, levels >= MEMBER_THRESHOLD, masks)
    return _distinct(_standing(context, levels, chosen, masks), context.views, chosen)


def _standing(context: SegmentationContext, levels: Float32, chosen: int, masks: Sequence[MaskEvidence]) -> Float32:
    """Return levels, [7, N], of which the chosen one is the object with its foot and without its pedestal.

    Where no mask was given, the outlines in the photos say what else is missing and too much (`_outlined`). The levels
    stay as they are if the masks show otherwise.

    Its foot belongs to this level and all larger ones, and what carries it only to larger ones.
    """
    members = levels[chosen] >= MEMBER_THRESHOLD
    whole = standing(members, context.surfaces, context.means) if masks else _outlined(context, members)
    if masks:
        before, after = _fits(context, np.stack([members, whole]), masks)
        if after < before - _LEVEL_COST:
            return levels
    foot, carrier = whole & ~members, members & ~whole
    changed = levels.copy()
    # Halves of the range keep the order of the levels, on the other side of the threshold.
    changed[: chosen + 1, carrier] *= BELOW_THRESHOLD
    changed[chosen:, foot] = 1 - (1 - changed[chosen:, foot]) * MEMBER_THRESHOLD
    return changed


def _outlined(context: SegmentationContext, members: Mask) -> Mask:
    """Return a set, [N], as it stands, with all of its foot and without what photos show beside its outlines."""
    graph = context.graph
    inside = graph.outline_shares(members, _FITTING_OUTLINE, by_most=False)
    whole = standing(members, context.surfaces, context.means, inside >= _LEAST_INSIDE)
    return whole & ~(graph.outline_shares(whole, _EXACT_OUTLINE, by_most=True) < _LEAST_INSIDE)


def _fitting(context: SegmentationContext, members: Mask, masks: Sequence[MaskEvidence]) -> int:
    """Return which of the nested sets [7, N] fits the masks best, and what the segments of the photos say."""
    if not masks:
        return _USUAL
    agreement = context.graph.outline_agreement(csr_matrix(members, dtype=np.float32))
    scores = _fits(context, members, masks) + _AGREEMENT_WEIGHT * agreement
    scores -= _LEVEL_COST * np.abs(np.arange(len(members)) - _USUAL)
    views = context.views
    possible = [number for number in range(len(members)) if number == _USUAL or views.extent(members[number]) <= 1]
    return max(possible, key=lambda number: float(scores[number]))


def _fits(context: SegmentationContext, members: Mask, masks: Sequence[MaskEvidence]) -> Float64:
    """Return the IoU of K sets, [K, N], with masks in the views of these: the mean over the masks, [K]."""
    shown = [(item, context.views.visible_masks(item.view, members)) for item in masks]
    return np.asarray(np.mean([[mask_iou(one, item.mask) for one in each] for item, each in shown], axis=0), np.float64)


def corrected(context: SegmentationContext, evidence: Sequence[MaskEvidence], before: Float32) -> Float32:
    """Return a membership with what evidence adds to it and removes from it, which may be all.

    Parameters
    ----------
    before : array of shape [N], float32

    Returns
    -------
    array of shape [N], float32
    """
    added, removed = (_union(context, evidence, _ONE_LEVEL, excluded=kind)[0] for kind in (False, True))
    return np.minimum(np.maximum(before, added), 1 - removed)


def _union(
    context: SegmentationContext, evidence: Sequence[MaskEvidence], factors: Float32, *, excluded: bool
) -> Float32:
    """Return the largest membership over the masks of one kind for each of K factors of the strictness, [K, N]."""
    highest = np.zeros((len(factors), len(context.means)), np.float32)
    for item in (item for item in evidence if item.excluded == excluded):
        highest = np.maximum(highest, _solved(context, [item], factors)[0])
    return highest


def _solved(context: SegmentationContext, items: Sequence[MaskEvidence], factors: Float32) -> Float32:
    """Return the memberships that each of J masks leads to for each of K factors of the strictness, [J, K, N]."""
    graph, n_factors = context.graph, len(factors)
    each = [count_votes(context.views, item, graph.pixels) for item in items]
    inside, outside = (
        np.repeat(np.stack(kind, axis=1), n_factors, axis=1)
        for kind in ([votes.inside for votes in each], [votes.outside for votes in each])
    )
    strictness = context.settings.strictness * np.tile(factors, len(items))
    shown = np.repeat(np.array([item.mask.sum() for item in items], np.float32), n_factors)
    solved = graph.memberships(Votes(inside, outside), strictness, shown, n_threads=len(usable_cores()))
    return solved.reshape(len(items), n_factors, -1)


def _distinct(memberships: Float32, views: Views, itself: int) -> Levels:
    """Return the levels that differ from those nearer to the object, number `itself`, at most a `length_unit` long."""
    kept = [itself]
    for number in sorted(range(len(memberships)), key=lambda number: abs(number - itself)):
        members = memberships[number] >= MEMBER_THRESHOLD
        same = any(mask_iou(members, memberships[other] >= MEMBER_THRESHOLD) > SAME_IOU for other in kept)
        if members.any() and not same and views.extent(members) <= 1:
            kept.append(number)
    return Levels(tuple(memberships[number] for number in sorted(kept)), sorted(kept).index(itself))
