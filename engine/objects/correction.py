"""Correction of an object: the Gaussians that clicks on something else remove from it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..events import StopCheck
from .context import SegmentationContext
from .evidence import evidence_of_clicks
from .lifting import lift, refine_by_votes
from .prompts import Point
from .settings import SegmentSettings
from .voting import has_majority_in_mask, votes_of_mask

__all__ = ["find_excluded_gaussians", "remove_gaussians"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_MAX_SHARE_OF_REST = 0.5  # chosen on museum_room
"""A clicked thing is removed as a whole when it contains less than this share of the rest of the object. A thing that
contains more was not separated from the object."""

_REMOVED_MEMBERSHIP = np.float32(0.25)  # by definition
"""Largest membership of a removed Gaussian: below the threshold, but within reach of the slider."""


def find_excluded_gaussians(
    excluded: Sequence[Point],
    clicks: Sequence[Point],
    members: Mask,
    context: SegmentationContext,
    settings: SegmentSettings,
    should_stop: StopCheck,
) -> Mask:
    """Return the Gaussians that clicks on something else remove from an object, bool [N].

    Parameters
    ----------
    excluded : sequence of Point
        Clicks on what does not belong to the object.
    clicks : sequence of Point
        Clicks on the object. SAM gets those in the same photo as background points.
    members : bool array of shape [N]
        The object before the correction.
    context : SegmentationContext
    settings : SegmentSettings
    should_stop : callable

    Raises
    ------
    PromptError
        For a click outside of its photo, or where no mask was found.
    Cancelled
        When `should_stop` returns True.

    Notes
    -----
    The Gaussians behind SAM's mask of the click are always removed. The whole clicked thing, including its far side, is
    removed where features and votes separate it from the rest of the object: where it contains less than half of that
    rest.
    """
    views = context.views
    removed = np.zeros(len(members), bool)
    for evidence in evidence_of_clicks(excluded, clicks, context, settings):
        hit = has_majority_in_mask(votes_of_mask(views, evidence.view, evidence.mask))
        removed |= hit
        lifted = lift(views, evidence.view, evidence.mask, settings, start=evidence.clicked_feature)
        if lifted is None:
            continue
        if settings.refinement == "votes":
            lifted = refine_by_votes(views, lifted, None, context.label_maps, settings, should_stop=should_stop)
        rest = members & ~hit
        if (lifted.members & rest).sum() < _MAX_SHARE_OF_REST * rest.sum():
            removed |= lifted.members
    return removed


def remove_gaussians(membership: Float32, removed: Mask) -> Float32:
    """Return the membership without the Gaussians `removed`; the slider can still bring them back."""
    return np.where(removed, np.minimum(membership, _REMOVED_MEMBERSHIP), membership).astype(np.float32)
