"""Evidence of an object, masks in views, and the votes of its pixels for each Gaussian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import Float32, Mask
from .views import THRESHOLD, View, Views

__all__ = ["BELOW_HALF", "THRESHOLD", "MaskEvidence", "Votes", "count_votes", "votes_of_known"]

BELOW_HALF = np.nextafter(np.float32(THRESHOLD), np.float32(0))  # by definition
"""Largest membership of a Gaussian that does not belong."""


@dataclass(frozen=True)
class MaskEvidence:
    """A mask in one view that shows the object of a prompt, or, `excluded`, a thing that is not part of it.

    The `mask`, [h, w], is in the frame of the `view`; all other pixels of the photo show something else. `score`, 0 to
    1, is the detector's for a text, SAM's estimate of its IoU for a click or a box, and 1 for a mask that is `given`:
    the user drew it, and it shows the whole object. Where the Gaussians of the object are known, `members`, [N], they
    vote for it instead of the pixels of the mask, and all others against it but those that the mask shows.
    """

    view: View
    mask: Mask
    score: float
    given: bool = False
    excluded: bool = False
    members: Mask | None = None


@dataclass(frozen=True)
class Votes:
    """Pixels that each Gaussian contributes to what evidence shows, and to what it shows beside: [N], float32."""

    inside: Float32
    outside: Float32


def count_votes(views: Views, item: MaskEvidence, pixels: Float32) -> Votes:
    """Return the votes of a mask: a pixel votes with the blending weights of its Gaussians.

    `pixels`, [N], are those with which each Gaussian votes where the members are known.
    """
    masks = np.dstack([item.mask, item.view.within & ~item.mask]).astype(np.float32)
    inside, outside = views.scene.votes(item.view.frame, masks).T
    if item.members is None:
        return Votes(inside, outside)
    return votes_of_known(item.members, pixels, undecided=inside > outside)


def votes_of_known(members: Mask, pixels: Float32, *, undecided: Mask | bool = False) -> Votes:
    """Return the votes of known members, bool [N], with `pixels` each; all others but `undecided` vote against."""
    return Votes(members * pixels, ~(members | undecided) * pixels)
