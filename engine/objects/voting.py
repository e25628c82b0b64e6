"""Votes of masks in several views for Gaussians, counted with the blending weights of the rasterizer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .selection import HALF
from .views import View, Views

__all__ = ["VoteCount", "has_majority_in_mask", "votes_of_mask"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]


class VoteCount:
    """Sum of the votes of several views for each Gaussian.

    A view votes with one mask or several. In each mask a Gaussian gets the number of pixels that it contributes there:
    the sum of its blending weights.

    Parameters
    ----------
    views : Views
        Views of the scene.

    Notes
    -----
    The vote A_in / (A_in + A_out) is the optimum of a binary assignment of Gaussians to masks (FlashSplat, Shen et al.
    2024).
    """

    def __init__(self, views: Views) -> None:
        self._views = views
        self._seen = np.zeros(len(views.scene), np.float32)
        self.inside = np.zeros((len(views.scene), 1), np.float32)
        """Pixels that each Gaussian contributes in each of K masks so far, shape [N, K]."""

    def add(self, view: View, masks: Mask) -> None:
        """Add the votes of K masks in a view, bool [h, w, K]; K is the same for all views."""
        self.inside = self.inside + self._views.scene.votes(view.frame, masks.astype(np.float32))
        self._seen += self._views.seen(view)

    def membership(self, prior: Float32) -> Float32:
        """Return the share of each Gaussian's pixels that is in the masks, in [0, 1].

        Parameters
        ----------
        prior : array of shape [N, K] or [N, 1], float32
            Membership before the votes. It counts as much as one pixel and decides where no view sees a Gaussian.

        Returns
        -------
        array of shape [N, K], float32
        """
        return ((self.inside + prior) / (self._seen[:, None] + 1.0)).astype(np.float32)


def votes_of_mask(views: Views, view: View, mask: Mask) -> Float32:
    """Return the pixels that each Gaussian contributes inside `mask`, bool [h, w], and outside of it: [N, 2]."""
    return views.scene.votes(view.frame, np.dstack([mask, view.within & ~mask]).astype(np.float32))


def has_majority_in_mask(votes: Float32) -> Mask:
    """Return which Gaussians contribute at least half a pixel to a mask, and more to it than outside of it, bool [N].

    Parameters
    ----------
    votes : array of shape [N, 2], float32
        As returned by `votes_of_mask`.
    """
    return np.asarray((votes[:, 0] >= HALF) & (votes[:, 0] > votes[:, 1]))
