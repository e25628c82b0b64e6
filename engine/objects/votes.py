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
    """A mask in one view that shows the object of a prompt, or something that is not part of it.

    Attributes
    ----------
    view : View
    mask : bool array of shape [h, w]
        In the frame of `view`. All other pixels of the photo show something else.
    score : float
        Confidence, 0 to 1: of the detector for a text, SAM's estimate of its IoU for a click or a box, 1 for a mask
        that the user drew.
    given : bool
        The user drew the mask, so it shows the whole object.
    excluded : bool
        The mask shows a thing that is not part of the object.
    members : bool array of shape [N], or None
        The Gaussians of the object, where they are known. They vote for it instead of the pixels of the mask, and all
        others against it but those that the mask shows.
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
