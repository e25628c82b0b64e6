"""Mask evidence of one prompt from several photos, merged into candidate objects in 3D."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled
from ..events import StopCheck
from ..masks import mask_iou
from .lifting import Lifted
from .views import View, Views
from .votes import MaskEvidence

__all__ = ["THRESHOLD", "Candidate", "build_candidates", "fit_of", "overlap"]

THRESHOLD = 0.5  # by definition
"""Smallest membership with which a Gaussian belongs to an object, until the user moves the slider."""

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass
class Candidate:
    """Mask evidence that shows the same object.

    Attributes
    ----------
    best : Lifted
        The first evidence, lifted to the Gaussians.
    evidence : list of MaskEvidence
        The best first.
    fit : float
        IoU of the first mask with the candidate rendered in the same view.
    """

    best: Lifted
    evidence: list[MaskEvidence]
    fit: float

    def add(self, item: MaskEvidence, lifted: Lifted, fit: float, *, better: bool) -> None:
        """Add evidence that shows the same object; `better` evidence becomes the first."""
        if better:
            self.best, self.fit = lifted, fit
            self.evidence.insert(0, item)
        else:
            self.evidence.append(item)


def fit_of(views: Views, view: View, mask: Mask, membership: Float32) -> float:
    """Return the IoU of a mask with the object rendered in the same view."""
    return mask_iou(views.visible_share(view, membership >= THRESHOLD) > 0.5, mask)


def overlap(first: Float32, second: Float32) -> float:
    """Return the number of common Gaussians of two memberships [N] as a share of the smaller object."""
    a, b = first >= THRESHOLD, second >= THRESHOLD
    smaller = min(int(a.sum()), int(b.sum()))
    return int((a & b).sum()) / smaller if smaller else 0.0


def build_candidates(
    views: Views,
    evidence: Sequence[MaskEvidence],
    same_object: float,
    lift: Callable[[MaskEvidence], Lifted | None],
    should_stop: StopCheck,
) -> list[Candidate]:
    """Lift each mask to the Gaussians and merge what shows the same ones, led by the mask with the best fit.

    Two masks show the same object when their Gaussians overlap by more than `same_object` of the smaller one.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """
    candidates: list[Candidate] = []
    for item in sorted(evidence, key=lambda item: -item.score):
        if should_stop():
            raise Cancelled("Stopped while isolating; no object was stored.")
        lifted = lift(item)
        if lifted is None:
            continue
        fit = fit_of(views, item.view, item.mask, lifted.membership)
        same = next((c for c in candidates if overlap(c.best.membership, lifted.membership) > same_object), None)
        if same is None:
            candidates.append(Candidate(lifted, [item], fit))
        else:
            same.add(item, lifted, fit, better=item.score * fit > same.evidence[0].score * same.fit)
    return candidates
