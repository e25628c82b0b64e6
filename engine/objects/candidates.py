"""Finds of one prompt in several photos, put together in 3D, and judged by what they look like from all sides."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled, PromptError
from ..events import StopCheck
from .lifting import Lifted, lift
from .photos import Photos
from .seeds import Seed
from .settings import SegmentSettings
from .views import View, Views, spread_cameras

if TYPE_CHECKING:
    from ..grounding.detector import Detector

__all__ = [
    "THRESHOLD",
    "Candidate",
    "NothingAlike",
    "crop_of",
    "crops_of",
    "fit_of",
    "gather",
    "looks_like",
    "overlap",
    "rank_for_text",
    "whole_as",
]

THRESHOLD = 0.5
"""Membership from which on a Gaussian belongs to an object, until the person moves the slider."""

_FEWEST_PIXELS = 60
"""Of a view's frame: less of an object says nothing about what it is."""

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


class NothingAlike(PromptError):
    """A text that nothing in the photos looks enough like.

    Attributes
    ----------
    candidates : tuple of (float, Candidate)
        What comes nearest with its score, the best first.
    """

    def __init__(self, message: str, candidates: Sequence[tuple[float, Candidate]]) -> None:
        super().__init__(message)
        self.candidates = tuple(candidates)


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


def rank_for_text(
    text: str,
    candidates: Sequence[Candidate],
    views: Views,
    photos: Photos,
    detector: Detector,
    settings: SegmentSettings,
    should_stop: StopCheck,
) -> list[tuple[float, Candidate]]:
    """Return the candidates worth keeping with their score, the best first; at least one.

    Parameters
    ----------
    text : str
    candidates : sequence of Candidate
    views : Views
    photos : Photos
    detector : Detector
    settings : SegmentSettings
        `n_rescored`, `n_crop_views`, `least_score`, `relative_score`, `max_objects`.
    should_stop : callable

    Raises
    ------
    NothingAlike
        When even the best is not worth keeping.
    Cancelled
        When `should_stop` says so.

    Notes
    -----
    The score is the geometric mean of two: what the detector said of the segments it was shown (`_agreement`), and
    what it says of the candidate in 3D, cut out of photos all around. A segment that looks like something else from
    one side, or holds more than the object, is found out by the second. On the museum room, ten prompts: the first
    alone put 8 of the right objects first, both together all 10 (``docs/text_prompts.md``).
    """
    looked_at = {seed.view.camera.photo for candidate in candidates for seed in candidate.seeds}
    scored = [(_agreement(views, candidate, looked_at), candidate) for candidate in candidates]
    scored.sort(key=lambda pair: -pair[0])
    if settings.n_rescored:
        again = []
        for score, candidate in scored[: settings.n_rescored]:
            if should_stop():
                raise Cancelled("Stopped while comparing what was found; no object was stored.")
            seen = looks_like(text, views, candidate.best.members, photos, detector, settings)
            again.append((float(np.sqrt(score * seen)), candidate))
        scored = sorted(again, key=lambda pair: -pair[0])
    best = scored[0][0]
    if best < settings.least_score:
        raise NothingAlike(
            f"Nothing in the photos looks enough like {text!r} (best match {best:.2f}, needed "
            f"{settings.least_score:.2f}). Use another word, or click on the object instead.",
            scored,
        )
    return [pair for pair in scored if pair[0] >= settings.relative_score * best][: settings.max_objects]


def _agreement(views: Views, candidate: Candidate, looked_at: set[str]) -> float:
    """Return the detector's score averaged over the views it looked at that face the candidate, times its fit.

    Where the detector found something else in such a view, it counts 0: a find that several views agree on wins over
    a louder one of a single view.
    """
    center = _center(views, candidate.best.members)
    facing = [camera.photo for camera in views.facing(center) if camera.photo in looked_at]
    by_photo: dict[str, float] = {}
    for seed in candidate.seeds:
        photo = seed.view.camera.photo
        by_photo[photo] = max(by_photo.get(photo, 0.0), seed.score)
    return min(1.0, sum(by_photo.values()) / max(len(facing), len(by_photo)) * candidate.fit)


def _center(views: Views, members: Mask) -> NDArray[np.floating]:
    center: NDArray[np.floating] = np.median(views.scene.gaussians.means[members], axis=0)
    return center


def looks_like(
    text: str, views: Views, members: Mask, photos: Photos, detector: Detector, settings: SegmentSettings
) -> float:
    """Return the detector's mean score of members, bool [N], as they are seen in photos from all around, 0 to 1."""
    scores = _scores_of(text, views, members, photos, detector, settings)
    return float(np.mean(scores)) if scores else 0.0


def whole_as(
    text: str, views: Views, members: Mask, photos: Photos, detector: Detector, settings: SegmentSettings
) -> float:
    """Return how much members, bool [N], look like a whole one of what `text` names, 0 to 1.

    Half of it is the mean over the photos, half the median: a version must win from most sides. A flowerpot with its
    plinth looked better than the pot from the one side where that alone was not recognised.
    """
    scores = _scores_of(text, views, members, photos, detector, settings)
    return float(np.mean(scores) + np.median(scores)) / 2 if scores else 0.0


def _scores_of(
    text: str, views: Views, members: Mask, photos: Photos, detector: Detector, settings: SegmentSettings
) -> list[float]:
    scores: list[float] = []
    for pixels, box, mask in crops_of(views, members, photos, settings):
        scores += detector.score_crops(pixels, [box], text, masks=[mask])
    return scores


def crops_of(
    views: Views, members: Mask, photos: Photos, settings: SegmentSettings
) -> Iterator[tuple[NDArray[np.uint8], list[int], Mask]]:
    """Yield photos from all around members, bool [N]: pixels, the box x0, y0, x1, y1 and the mask of what is seen."""
    if not members.any():
        return
    for camera in spread_cameras(views.facing(_center(views, members)), settings.n_crop_views):
        view = views.of(camera)
        shown = views.visible_share(view, members) > 0.5
        if int(shown.sum()) < _FEWEST_PIXELS:
            continue
        crop = crop_of(view, shown, photos)
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
