"""Lifting: from evidence in views to the Gaussians of an object, by one solve on the graph of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..events import StopCheck
from ..masks import mask_iou
from .context import SegmentationContext
from .graph import bounded
from .settings import SegmentSettings
from .views import MAX_OBJECT_EXTENT
from .votes import THRESHOLD, MaskEvidence, Votes, count_votes

__all__ = ["Levels", "lift", "lift_levels"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_LEVELS = (16.0, 4.0, 1.0, 0.25, 0.0625)  # by definition
"""Strictness of each level relative to the settings, from part to whole."""

_SAME_LEVEL_IOU = 0.9  # by definition
"""IoU above which two levels are the same."""


@dataclass(frozen=True)
class Levels:
    """Memberships from part to whole, each contained in the next.

    Attributes
    ----------
    memberships : tuple of arrays of shape [N], float32
        At least one.
    chosen : int
        Index of the level that becomes the object unless the user chooses another one.
    """

    memberships: tuple[Float32, ...]
    chosen: int = 0  # by definition

    @property
    def membership(self) -> Float32:
        """The chosen level."""
        return self.memberships[self.chosen]


def lift(
    context: SegmentationContext,
    evidence: Sequence[MaskEvidence],
    settings: SegmentSettings,
    *,
    before: Float32 | None = None,
    should_stop: StopCheck,
) -> Float32:
    """Return the membership, [N], in the object that `evidence` shows; there may be no members.

    Several masks show one object together, even where no mask shows all of it.

    Parameters
    ----------
    context : SegmentationContext
    evidence : sequence of MaskEvidence
    settings : SegmentSettings
        `strictness` and `n_vote_views`.
    before : array of shape [N], optional
        Membership that the evidence corrects.
    should_stop : callable

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """
    if before is None:
        return _solve(context, evidence, settings, (1.0,), should_stop)[0]
    added, removed = (
        _union(context, [item for item in evidence if item.excluded == kind], settings, (1.0,), should_stop)[0]
        for kind in (False, True)
    )
    return np.minimum(np.maximum(before, added), 1 - removed)


def lift_levels(
    context: SegmentationContext, evidence: Sequence[MaskEvidence], settings: SegmentSettings, should_stop: StopCheck
) -> Levels:
    """Return the object of `lift` with clearly smaller and larger versions; parameters and errors as there.

    The membership falls as the strictness rises, so that each level contains those of higher strictness.
    """
    solved = _solve(context, evidence, settings, _LEVELS, should_stop)
    # Rounding must not let a level leave the next one.
    solved = list(np.maximum.accumulate(solved))
    chosen = _LEVELS.index(1.0)
    kept = [chosen]
    for number in sorted(range(len(_LEVELS)), key=lambda number: abs(number - chosen)):
        members = solved[number] >= THRESHOLD
        same = any(mask_iou(members, solved[other] >= THRESHOLD) > _SAME_LEVEL_IOU for other in kept)
        if members.any() and not same and context.views.extent(members) <= MAX_OBJECT_EXTENT:
            kept.append(number)
    return Levels(tuple(solved[number] for number in sorted(kept)), sorted(kept).index(chosen))


def _solve(
    context: SegmentationContext,
    evidence: Sequence[MaskEvidence],
    settings: SegmentSettings,
    factors: Sequence[float],
    should_stop: StopCheck,
) -> list[Float32]:
    """Return the membership for each factor of the strictness: in what any mask shows, without what is excluded."""
    shown = [item for item in evidence if not item.excluded]
    removed = _union(context, [item for item in evidence if item.excluded], settings, (1.0,), should_stop)[0]
    solved = _union(context, shown, settings, factors, should_stop)
    means = context.views.scene.gaussians.means
    return [bounded(np.minimum(membership, 1 - removed), means) for membership in solved]


def _union(
    context: SegmentationContext,
    evidence: Sequence[MaskEvidence],
    settings: SegmentSettings,
    factors: Sequence[float],
    should_stop: StopCheck,
) -> list[Float32]:
    """Return the largest membership over the masks for each factor of the strictness."""
    graph = context.graph(settings, should_stop)
    strictness = settings.strictness * np.array(factors, np.float32)
    highest = np.zeros((len(factors), len(graph.pixels)), np.float32)
    for item in evidence:
        votes = count_votes(context.views, item, graph.pixels)
        repeated = (np.repeat(each[:, None], len(factors), axis=1) for each in (votes.inside, votes.outside))
        highest = np.maximum(highest, graph.solve_each(Votes(*repeated), strictness).T)
    return list(highest)
