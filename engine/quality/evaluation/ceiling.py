"""The detector on the true masks: which words a perfect segmentation would let it find."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Mask
from ...core.errors import Cancelled
from ...core.events import StopCheck
from ...masks import mask_box
from ...objects import Photos, spread_cameras
from ...scene import Camera
from .comparison import resized
from .ground_truth import GroundTruth

if TYPE_CHECKING:
    from ...objects.grounding import Detector

_MIN_VISIBLE_SHARE = 0.25
"""Smallest area of an object in a photo, as a share of its area in the selected photo that shows most of it."""


def words_of_true_masks(
    truth: GroundTruth,
    objects: Sequence[str],
    cameras: Mapping[str, Camera],
    photos: Photos,
    detector: Detector,
    *,
    n_photos: int,
    should_stop: StopCheck,
) -> dict[str, str] | None:
    """Return for the word of each object the word that the detector scores highest on the object's true mask.

    Parameters
    ----------
    truth : GroundTruth
        The words are those of all its objects and of the things that it says are absent.
    objects : sequence of str
        Objects whose words are looked up.
    cameras : mapping of str to Camera
        Photos that may be looked at. Only those with true masks are.
    n_photos : int
        Largest number of photos that an object is cut out of.

    Returns
    -------
    dict of str to str, or None
        A word is mapped to itself if its score is the highest, or one of the highest, and above 0. Of equal objects one
        is enough. Empty texts stand for objects on which every word scores 0. Words of objects that no photo shows are
        missing. None if all are missing, and for a detector that describes no crops.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    MaskError, PhotoError
        When a mask or a photo cannot be read.

    Notes
    -----
    The objects are cut out of up to `n_photos` photos from all sides. A score is the average of the mean and the median
    of those in the photos.
    """
    words = [*dict.fromkeys(truth.prompts.values()), *truth.absent]
    words = [word for word in words if detector.check_prompt(word).known]
    masks = {photo: truth.masks(photo) for photo in truth.photos if photo in cameras}
    first: dict[str, str] = {}
    for name in objects:
        if should_stop():
            raise Cancelled("Stopped while scoring the true masks; nothing was written.")
        shown = [cameras[photo] for photo, those in masks.items() if name in those]
        word = truth.prompts[name]
        if not shown or first.get(word) == word:
            continue
        selected = spread_cameras(shown, n_photos)
        scores = _scores(detector, words, photos, [(camera, masks[camera.photo][name]) for camera in selected])
        best = max(scores.values(), default=0.0)
        if best > 0:
            first[word] = word if scores.get(word) == best else max(scores, key=lambda text: scores[text])
        else:
            first.setdefault(word, "")
    return first or None


def _scores(
    detector: Detector, words: Sequence[str], photos: Photos, sightings: Sequence[tuple[Camera, Mask]]
) -> dict[str, float]:
    """Return the score of each word for one object, from its true masks in photos."""
    areas = [float(mask.mean()) for _, mask in sightings]
    found: dict[str, list[float]] = {word: [] for word in words}
    for (camera, mask), area in zip(sightings, areas, strict=True):
        if area < _MIN_VISIBLE_SHARE * max(areas):
            continue
        pixels = photos.pixels(camera)
        inside = resized(mask, pixels.shape[:2], camera.photo)
        box = mask_box(inside)
        if box is None:
            continue
        described = detector.describe_crops(pixels, [box], [inside])
        if described is not None:
            for word in words:
                found[word] += detector.score_descriptions(described, word)
    return {word: float(np.mean(each) + np.median(each)) / 2 if each else 0.0 for word, each in found.items()}
