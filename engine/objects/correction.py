"""What a person says does not belong to an object, and which Gaussians that takes away."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..events import StopCheck
from .evidence import evidence_of_clicks
from .lifting import behind, lift, refine_by_votes, votes_of_mask
from .photos import Photos
from .prompts import Point
from .settings import SegmentSettings
from .views import Views

__all__ = ["taken_away", "without"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_HALF = np.float32(0.5)
_SHARED = 0.5


def taken_away(
    excluded: Sequence[Point],
    clicks: Sequence[Point],
    kept: Mask,
    views: Views,
    photos: Photos,
    label_maps: Mapping[str, NDArray[np.int32]],
    settings: SegmentSettings,
    should_stop: StopCheck,
) -> Mask:
    """Return the Gaussians that clicks on something else take away from an object, bool [N].

    Parameters
    ----------
    excluded : sequence of Point
        Clicks on what does not belong to the object.
    clicks : sequence of Point
        Clicks on the object: SAM is told of those in the same photo.
    kept : bool array of shape [N]
        The object as it would be without `excluded`.
    views, photos, label_maps, settings, should_stop
        As in `engine.objects.lifting.refine_by_votes`.

    Raises
    ------
    PromptError
        For a click beside a photo, or where nothing is.
    Cancelled
        When `should_stop` says so.

    Notes
    -----
    What lies behind SAM's mask of the click goes in any case. The whole thing that was hit, its far side too, goes
    where features and votes tell it from the rest of the object: it then holds less than half of that rest.
    """
    away = np.zeros(len(kept), bool)
    for seed in evidence_of_clicks(excluded, clicks, views, photos, settings):
        hit = behind(votes_of_mask(views, seed.view, seed.mask))
        away |= hit
        lifted = lift(views, seed.view, seed.mask, settings, start=seed.start)
        if lifted is None:
            continue
        if settings.refinement == "votes":
            lifted = refine_by_votes(views, lifted, None, label_maps, settings, should_stop=should_stop)
        rest = kept & ~hit
        if (lifted.members & rest).sum() < _SHARED * rest.sum():
            away |= lifted.members
    return away


def without(membership: Float32, away: Mask) -> Float32:
    """Return the membership with Gaussians taken away; the slider can still bring them back."""
    return np.where(away, np.minimum(membership, np.float32(0.25)), membership).astype(np.float32)
