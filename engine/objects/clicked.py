"""The meaning of clicks on a photo, as masks of that photo, while the user is still clicking."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ..core.arrays import Mask
from .choosing import kept_objects
from .context import SegmentationContext
from .evidence import evidence_of_places, places_in
from .meant import whole_evidence
from .prompts import Point, camera_of_prompt


@dataclass(frozen=True)
class ClickMasks:
    """Masks of a photo, each empty without such clicks or without an object.

    Attributes
    ----------
    wanted : array of shape [H, W], bool
        What the clicks on the object show, without `unwanted`. H and W are the full size after EXIF rotation.
    unwanted : array of shape [H, W], bool
        What the excluded clicks show.
    present : array of shape [H, W], bool
        Where the object that is corrected is visible now.
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
    """Return what the engine takes clicks on a photo for: the masks that `isolate` and `refine` begin with.

    A new object is shown as a whole where the objects of the scene are known, which the first isolated one needs. The
    first call for a photo renders it, and for excluded clicks loads SAM's embedding; further ones take hundredths of a
    second.

    Parameters
    ----------
    clicks, excluded : sequence of Point
        Those on other photos only say which object of the scene is meant.
    members : array of shape [N], bool, or None
        Gaussians of the object that is corrected.

    Raises
    ------
    PromptError
        For an unknown photo, or a click outside of its photo.
    """
    here, beside = places_in(photo, clicks), places_in(photo, excluded)
    for point in (*clicks, *excluded):
        camera_of_prompt(point, context.views.cameras)
    camera = camera_of_prompt(Point(photo, 0.0, 0.0), context.views.cameras)
    view, shape = context.views.of(camera), (camera.height, camera.width)
    nothing = np.zeros(shape, bool)
    wanted = nothing
    if here:
        item = evidence_of_places(here, view, context)
        objects = None if members is not None else kept_objects(context)
        if objects is not None:
            (item,) = whole_evidence(context, clicks, [item], objects) or [item]
        wanted = view.to_photo(item.mask)
    unwanted = nothing
    if beside:
        small, _ = context.photos.segment(camera, points=beside, outside=here)
        unwanted = cv2.resize(small.astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    present = nothing if members is None else view.to_photo(context.views.visible(view, members))
    return ClickMasks(wanted & ~unwanted, unwanted, present)
