"""Evidence of an object, masks in views, and the votes of its pixels for each Gaussian."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .views import View, Views

__all__ = ["BELOW_HALF", "HALF", "MaskEvidence", "Votes", "count_votes"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

HALF = np.float32(0.5)  # by definition
"""Membership from which on a Gaussian belongs to an object."""

BELOW_HALF = np.nextafter(HALF, np.float32(0))  # by definition
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
        Confidence, 0 to 1: of the detector for a text, SAM's estimate of its IoU for a click or a box, 1 for a given
        mask.
    given : bool
        The user drew the mask, so it shows the whole object.
    excluded : bool
        The mask shows a thing that is not part of the object.
    members : bool array of shape [N], or None
        The Gaussians that the mask shows, where they are known; they vote instead of the mask.
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


def count_votes(views: Views, evidence: Sequence[MaskEvidence], pixels: Float32) -> Votes:
    """Return the votes of evidence for one object; a pixel votes with the blending weights of its Gaussians.

    What one mask shows may be hidden, or left out, in another photo: there the pixels beside the mask do not count for
    Gaussians that are mostly inside of another mask.

    Parameters
    ----------
    views : Views
    evidence : sequence of MaskEvidence
    pixels : array of shape [N], float32
        Pixels with which a Gaussian votes where the members are known.
    """
    counted = [_votes_of(views, item, pixels) for item in evidence]
    shown = np.array([votes[:, 0] > votes[:, 1] for votes in counted]).reshape(len(counted), len(pixels))
    inside, outside = np.zeros((2, len(pixels)), np.float32)
    for number, votes in enumerate(counted):
        inside += votes[:, 0]
        outside += np.where(np.delete(shown, number, axis=0).any(axis=0), 0, votes[:, 1])
    return Votes(inside, outside)


def _votes_of(views: Views, item: MaskEvidence, pixels: Float32) -> Float32:
    """Return the pixels of each Gaussian inside of a mask and beside it, [N, 2]."""
    if item.members is not None:
        return np.stack([item.members, ~item.members], axis=1) * pixels[:, None]
    masks = np.dstack([item.mask, item.view.within & ~item.mask]).astype(np.float32)
    return views.scene.votes(item.view.frame, masks)
