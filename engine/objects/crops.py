"""Crops of the photos that show a set of Gaussians, for a detector to look at."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from ..masks import mask_box
from .photos import Photos
from .settings import SegmentSettings
from .views import View, Views, spread_cameras

__all__ = ["MIN_VISIBLE_PIXELS", "crop_photo", "crop_photos", "median_center"]

MIN_VISIBLE_PIXELS = 60  # chosen on museum_room
"""Smallest area of an object in a view's frame, in pixels. A smaller area does not show what the object is."""

_MIN_VISIBLE_SHARE = 0.25  # chosen on museum_room, store_room
"""Smallest area of an object in a view, as a share of its area in the view that shows most of it. Where less is
visible, something else hides the object."""

Mask = NDArray[np.bool_]


def median_center(views: Views, members: Mask) -> NDArray[np.floating]:
    """Return the median position of the Gaussians `members`, bool [N]; shape [3]."""
    center: NDArray[np.floating] = np.median(views.scene.gaussians.means[members], axis=0)
    return center


def crop_photos(
    views: Views, members: Mask, photos: Photos, settings: SegmentSettings
) -> Iterator[tuple[NDArray[np.uint8], list[int], Mask]]:
    """Yield crops of photos from all sides of the Gaussians `members`, bool [N], as `crop_photo` returns them.

    Photos in which most of the object is hidden are left out.

    Parameters
    ----------
    views : Views
    members : bool array of shape [N]
    photos : Photos
    settings : SegmentSettings
        `n_crop_views`.
    """
    if not members.any():
        return
    visible: list[tuple[View, Mask, int]] = []
    for camera in spread_cameras(views.facing(median_center(views, members)), settings.n_crop_views):
        view = views.of(camera)
        mask = views.visible_share(view, members) > 0.5
        visible.append((view, mask, int(mask.sum())))
    min_area = max(MIN_VISIBLE_PIXELS, _MIN_VISIBLE_SHARE * max((area for _, _, area in visible), default=0))
    for view, mask, area in visible:
        crop = crop_photo(view, mask, photos) if area >= min_area else None
        if crop is not None:
            yield crop


def crop_photo(view: View, visible: Mask, photos: Photos) -> tuple[NDArray[np.uint8], list[int], Mask] | None:
    """Return the photo of a view with the box and the mask of what is visible in the view.

    Parameters
    ----------
    view : View
    visible : bool array of shape [h, w]
        In the frame of `view`.
    photos : Photos

    Returns
    -------
    (array of shape [H, W, 3], list of int, bool array of shape [H, W]), or None
        The pixels of the photo, the box x0, y0, x1, y1 and the mask in those pixels. None for an empty mask.
    """
    pixels = photos.pixels(view.camera)
    size = (pixels.shape[1], pixels.shape[0])
    mask = cv2.resize(view.to_photo(visible).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    box = mask_box(mask)
    return None if box is None else (pixels, list(box), mask)
