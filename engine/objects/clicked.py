"""What clicks on a photo mean, as masks of that photo, while the user is still clicking."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from .arrays import Mask
from .context import SegmentationContext
from .evidence import evidence_of_places, places_in
from .prompts import Point, camera_of_prompt
from .votes import THRESHOLD

__all__ = ["ClickMasks", "click_masks"]


@dataclass(frozen=True)
class ClickMasks:
    """Masks of a photo, bool [H, W] of its full size after EXIF rotation.

    `wanted` is what the clicks on the object show, without what is `unwanted`, the masks of the clicks beside it;
    `present` is where the object that is corrected is visible now. A mask without such clicks, or without an object,
    is empty.
    """

    wanted: Mask
    unwanted: Mask
    present: Mask


def click_masks(
    context: SegmentationContext,
    photo: str,
    clicks: Sequence[Point],
    excluded: Sequence[Point],
    members: Mask | None = None,
) -> ClickMasks:
    """Return what the engine takes clicks on `photo` for; those on other photos change nothing here.

    `members`, bool [N], are the Gaussians of the object that is corrected. These are the masks that `isolate` and
    `refine` begin with. The first call for a photo renders it, and for excluded clicks loads SAM's embedding; further
    ones take hundredths of a second. Raises `PromptError` for a click outside of the photo, or an unknown photo.
    """
    here, beside = places_in(photo, clicks), places_in(photo, excluded)
    for point in (*clicks, *excluded):
        camera_of_prompt(point, context.views.cameras)
    camera = camera_of_prompt(Point(photo, 0.0, 0.0), context.views.cameras)
    view, shape = context.views.of(camera), (camera.height, camera.width)
    nothing = np.zeros(shape, bool)
    wanted = view.to_photo(evidence_of_places(here, view, context).mask) if here else nothing
    unwanted = nothing
    if beside:
        small, _ = context.photos.segment(camera, points=beside, outside=here)
        unwanted = cv2.resize(small.astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    visible = None if members is None else context.views.visible_share(view, members) > THRESHOLD
    present = nothing if visible is None else view.to_photo(visible)
    return ClickMasks(wanted & ~unwanted, unwanted, present)
