"""Found objects, as all methods return them: memberships from part to whole, and when two show the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float32, Mask
from ..masks import mask_iou
from .context import SegmentationContext
from .settings import MEMBER_THRESHOLD
from .views import Views
from .votes import MaskEvidence

NONE_BEHIND = "No Gaussian of the scene lies behind what was found in the photos. Choose another photo or prompt."
NONE_LEFT = "Nothing is left of the object: the excluded clicks removed all of it. Click elsewhere."

BELOW_THRESHOLD = np.nextafter(np.float32(MEMBER_THRESHOLD), np.float32(0))
"""Largest membership of a Gaussian that does not belong to a new object."""

MAX_COMMON = 0.5
"""Share of the smaller of two sets of Gaussians up to which both may be objects: more shows the same."""


@dataclass(frozen=True)
class Levels:
    """Memberships from part to whole, each contained in the next.

    Attributes
    ----------
    memberships : tuple of arrays of shape [N], float32
        0 to 1.
    chosen : int
        Index of the level that is the object for now.
    """

    memberships: tuple[Float32, ...]
    chosen: int = 0


@dataclass(frozen=True)
class FoundObject:
    """An object before it is stored, in smaller and larger versions.

    Attributes
    ----------
    levels : Levels
    score : float
        That of `ObjectRecord`, 0 to 1.
    fit : float
        IoU of the object with the best mask of its evidence, in the view of this mask.
    evidence : tuple of MaskEvidence
        Masks that show it, the best first.
    name : str
        Suggested by the detector; may be empty.
    id : str
        Of a stored object that it replaces, or empty.
    """

    levels: Levels
    score: float = 1.0
    fit: float = 1.0
    evidence: tuple[MaskEvidence, ...] = ()
    name: str = ""
    id: str = ""

    @property
    def membership(self) -> Float32:
        """Membership of each Gaussian, in [0, 1], shape [N]."""
        return self.levels.memberships[self.levels.chosen]

    @property
    def members(self) -> Mask:
        """Gaussians that belong to the object, bool [N]."""
        return self.membership >= MEMBER_THRESHOLD


def fit_of(item: MaskEvidence, members: Mask, views: Views) -> float:
    """Return the IoU of a mask with the members, bool [N], rendered in the same view."""
    return mask_iou(views.visible(item.view, members), item.mask)


def is_same(first: Mask, second: Mask) -> bool:
    """Return whether two results, bool [N], show the same object: more than half of the smaller one is common."""
    return int((first & second).sum()) > MAX_COMMON * min(int(first.sum()), int(second.sum()))


def nothing_found(text: str, context: SegmentationContext) -> str:
    """Return the sentence on a text that the detector knows and finds in no photo."""
    count = min(context.settings.n_text_views, len(context.label_maps) or len(context.views.cameras.cameras))
    return f"{text!r} was not found in {count} photos. Use another word, or click on the object instead."
