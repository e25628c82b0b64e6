"""Evidence of an object, masks in views, and the votes of its pixels for each Gaussian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float32, Mask
from .views import View, Views


@dataclass(frozen=True)
class MaskEvidence:
    """A mask in one view that shows the object of a prompt, or a thing that is not part of it.

    Attributes
    ----------
    view : View
    mask : array of shape [h, w], bool
        In the frame of the view. All other pixels of the photo show something else.
    score : float
        0 to 1: the detector's for a text, SAM's estimate of its IoU for a click or a box, 1 for a given mask.
    excluded : bool
        The mask shows what is not part of the object.
    members : array of shape [N], bool, or None
        The Gaussians of the object where they are known. They vote for it in place of the pixels of the mask, and all
        others against it but those that the mask shows.
    undecided : array of shape [N], bool, or None
        The Gaussians that the mask shows, where that was kept; see `undecided_by`.
    example : array of shape [E], float32, or None
        What the members teach as an example of a word, where that is known; see `Detector.example_vectors`.
    """

    view: View
    mask: Mask
    score: float
    excluded: bool = False
    members: Mask | None = None
    undecided: Mask | None = None
    example: Float32 | None = None


@dataclass(frozen=True)
class Votes:
    """Pixels, in blending weights, that each Gaussian contributes to what evidence shows, and to the rest of the photo.

    Attributes
    ----------
    inside, outside : array of shape [N] or [N, K], float32
        K is the number of sets that are solved together.
    """

    inside: Float32
    outside: Float32


def count_votes(views: Views, item: MaskEvidence, pixels: Float32) -> Votes:
    """Return the votes of a mask: a pixel votes with the blending weights of its Gaussians.

    Parameters
    ----------
    pixels : array of shape [N], float32
        Pixels with which each Gaussian votes where the members are known.
    """
    if item.members is None:
        return Votes(*_shown_by(views, item))
    undecided = undecided_by(views, item) if item.undecided is None else item.undecided
    return votes_of_known(item.members, pixels, undecided=undecided)


def undecided_by(views: Views, item: MaskEvidence) -> Mask:
    """Return the Gaussians that a mask shows more than the rest of its photo does, [N]."""
    inside, outside = _shown_by(views, item)
    return np.asarray(inside > outside)


def _shown_by(views: Views, item: MaskEvidence) -> Float32:
    """Return the pixels that each Gaussian contributes to a mask, and to the rest of its photo, [2, N]."""
    masks = np.dstack([item.mask, item.view.within & ~item.mask]).astype(np.float32)
    return views.scene.votes(item.view.frame, masks).T


def votes_of_known(members: Mask, pixels: Float32, *, undecided: Mask | bool = False) -> Votes:
    """Return the votes of known members.

    Parameters
    ----------
    members : array of shape [N] or [N, K], bool
    pixels : array of shape [N] or [N, 1], float32
        Pixels with which each Gaussian votes.
    undecided : array of the shape of `members`, bool, or bool
        Gaussians that do not vote. All others vote against the members.
    """
    return Votes(members * pixels, ~(members | undecided) * pixels)
