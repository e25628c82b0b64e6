"""Finds of one prompt in several photos, put together in 3D, and cut out of the photos all around."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled
from ..events import StopCheck
from .evidence import Seed
from .lifting import Lifted, lift
from .photos import Photos
from .settings import SegmentSettings
from .views import View, Views, spread_cameras

__all__ = [
    "FEWEST_PIXELS",
    "THRESHOLD",
    "Candidate",
    "center_of",
    "crop_of",
    "crops_of",
    "fit_of",
    "gather",
    "overlap",
]

THRESHOLD = 0.5
"""Membership from which on a Gaussian belongs to an object, until the person moves the slider."""

FEWEST_PIXELS = 60
"""Of a view's frame: less of an object says nothing about what it is."""

_LEAST_SEEN = 0.25
"""Of the pixels of the photo that shows most of an object."""

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass
class Candidate:
    """Seeds that turned out to show one object.

    Attributes
    ----------
    best : Lifted
        From the first seed.
    seeds : list of Seed
        The one that fits best first.
    fit : float
        Intersection over union of the best seed's mask with the object in its view.
    """

    best: Lifted
    seeds: list[Seed]
    fit: float


def fit_of(views: Views, view: View, mask: Mask, membership: Float32) -> float:
    """Return the IoU of a mask with the object rendered in the same view."""
    shown = views.visible_share(view, membership >= THRESHOLD) > 0.5
    union = int((shown | mask).sum())
    return int((shown & mask).sum()) / union if union else 0.0


def overlap(one: Float32, other: Float32) -> float:
    """Return the common Gaussians as a part of the smaller object's."""
    a, b = one >= THRESHOLD, other >= THRESHOLD
    smaller = min(int(a.sum()), int(b.sum()))
    return int((a & b).sum()) / smaller if smaller else 0.0


def gather(views: Views, seeds: Sequence[Seed], settings: SegmentSettings, should_stop: StopCheck) -> list[Candidate]:
    """Lift every seed and put those that show the same Gaussians together, led by the one that fits its mask best.

    Raises
    ------
    Cancelled
        When `should_stop` says so.
    """
    found: list[Candidate] = []
    for seed in sorted(seeds, key=lambda seed: -seed.score):
        if should_stop():
            raise Cancelled("Stopped while isolating; no object was stored.")
        wanted = settings if seed.whole else replace(settings, parts=1)
        lifted = lift(views, seed.view, seed.mask, wanted, start=seed.start, given=seed.given)
        if lifted is None:
            continue
        fit = fit_of(views, seed.view, seed.mask, lifted.membership)
        same = next((c for c in found if overlap(c.best.membership, lifted.membership) > settings.same_object), None)
        if same is None:
            found.append(Candidate(lifted, [seed], fit))
        elif seed.score * fit > same.seeds[0].score * same.fit:
            same.best, same.fit = lifted, fit
            same.seeds.insert(0, seed)
        else:
            same.seeds.append(seed)
    return found


def center_of(views: Views, members: Mask) -> NDArray[np.floating]:
    """Return the median position of members, bool [N], shape [3]."""
    center: NDArray[np.floating] = np.median(views.scene.gaussians.means[members], axis=0)
    return center


def crops_of(
    views: Views, members: Mask, photos: Photos, settings: SegmentSettings
) -> Iterator[tuple[NDArray[np.uint8], list[int], Mask]]:
    """Yield photos from all around members, bool [N]: pixels, the box x0, y0, x1, y1 and the mask of what is seen.

    Photos in which little of them is left, since something else stands before them, are left out.
    """
    if not members.any():
        return
    shown: list[tuple[View, Mask, int]] = []
    for camera in spread_cameras(views.facing(center_of(views, members)), settings.n_crop_views):
        view = views.of(camera)
        mask = views.visible_share(view, members) > 0.5
        shown.append((view, mask, int(mask.sum())))
    least = max(FEWEST_PIXELS, _LEAST_SEEN * max((area for _, _, area in shown), default=0))
    for view, mask, area in shown:
        crop = crop_of(view, mask, photos) if area >= least else None
        if crop is not None:
            yield crop


def crop_of(view: View, shown: Mask, photos: Photos) -> tuple[NDArray[np.uint8], list[int], Mask] | None:
    """Return a photo, the box x0, y0, x1, y1 and the mask in its pixels of what a view shows; None of nothing."""
    pixels = photos.pixels(view.camera)
    size = (pixels.shape[1], pixels.shape[0])
    mask = cv2.resize(view.to_photo(shown).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    if len(columns) == 0:
        return None
    return pixels, [int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1], mask
