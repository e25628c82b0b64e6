"""From a prompt to masks in photos: given, by SAM from a click or box, or by a text detector in several views."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled, PromptError
from ..events import Emit, Progress, StopCheck
from ..scene import Camera
from .photos import Photos, SamFactory
from .prompts import BoxPrompt, ClickPrompt, MaskPrompt, Point, Prompt, TextPrompt, camera_of_prompt, load_mask
from .settings import SegmentSettings
from .views import View, Views, spread_cameras

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = ["DetectorFactory", "Photos", "SamFactory", "Seed", "find_evidence", "evidence_of_clicks"]

DetectorFactory = Callable[[], "Detector"]

Mask = NDArray[np.bool_]
Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class Seed:
    """A mask in one view that may show what was asked for.

    Attributes
    ----------
    view : View
    mask : bool array of shape [h, w]
        In the frame of `view`.
    score : float
        0 to 1: the detector's for a text, SAM's guess of its own mask for a click or box, 1 for a given mask.
    start : array of shape [D], float32, or None
        Feature of the clicked pixel.
    given : bool
        The person drew the mask; it is not to be improved.
    whole : bool
        The mask is meant to be the whole object, so that all its parts count. A click's may leak into something
        else or be one part only: there the clicked feature leads.
    members : bool array of shape [N], or None
        The Gaussians that the mask shows, where they are known and not to be found by their features.
    """

    view: View
    mask: Mask
    score: float
    start: Float32 | None = None
    given: bool = False
    whole: bool = True
    members: Mask | None = None


def find_evidence(
    prompt: Prompt,
    views: Views,
    photos: Photos,
    label_maps: Mapping[str, NDArray[np.int32]],
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
) -> list[Seed]:
    """Return masks that may show what `prompt` asks for; at least one, other than for a text.

    Parameters
    ----------
    prompt : Prompt
    views : Views
    photos : Photos
    label_maps : mapping of str to int32 array of shape [h, w]
        SAM label maps by photo: a text detector chooses among their segments. May be empty.
    settings : SegmentSettings
    detector_factory : callable
        Called only for a text.
    emit, should_stop
        See `engine.events`.

    Raises
    ------
    PromptError
        When nothing was found at a place; for a text outside of the detector's words with the nearest it knows.
    MaskError
        When a given mask cannot be used.
    Cancelled
        When `should_stop` says so.
    """
    if isinstance(prompt, TextPrompt):
        return _from_text(prompt, views, photos, label_maps, settings, detector_factory, emit, should_stop)
    for point in prompt.excluded:
        camera_of_prompt(point, views.cameras)
    if isinstance(prompt, ClickPrompt):
        return evidence_of_clicks(prompt.clicks, prompt.excluded, views, photos, settings)
    camera = camera_of_prompt(prompt, views.cameras)
    view = views.of(camera)
    if isinstance(prompt, MaskPrompt):
        return [_something(Seed(view, view.from_photo(load_mask(prompt.mask, camera)), 1.0, given=True))]
    return [_something(_from_box(prompt, view, photos))]


def evidence_of_clicks(
    clicks: Sequence[Point], excluded: Sequence[Point], views: Views, photos: Photos, settings: SegmentSettings
) -> list[Seed]:
    """Return a seed for each photo that was clicked into, from all clicks in it.

    Parameters
    ----------
    clicks : sequence of Point
        On the object.
    excluded : sequence of Point
        On what is not part of it; SAM is told of those in the same photo.
    views : Views
    photos : Photos
    settings : SegmentSettings

    Raises
    ------
    PromptError
        For a click beside a photo, or where nothing is.
    """
    by_photo: dict[str, list[Point]] = {}
    for point in clicks:
        camera_of_prompt(point, views.cameras)
        by_photo.setdefault(point.photo, []).append(point)
    seeds = []
    for photo, points in by_photo.items():
        view = views.of(camera_of_prompt(points[0], views.cameras))
        outside = [point for point in excluded if point.photo == photo]
        seeds.append(_something(_from_clicks(points, outside, view, photos, settings)))
    return seeds


def _something(seed: Seed) -> Seed:
    if not seed.mask.any():
        photo = seed.view.camera.photo
        raise PromptError(f"Nothing was found at that place of {photo}. Click on the middle of the object.")
    return seed


def _from_clicks(
    clicks: Sequence[Point], outside: Sequence[Point], view: View, photos: Photos, settings: SegmentSettings
) -> Seed:
    """Return SAM's mask that best fits the instance the features show at the clicked pixels.

    SAM's answer to a single point is often only a part of the object. The box of the pixels with a feature like a
    clicked one asks it again. The second answer is taken when it is more like those pixels (the paper's best-fitting
    instance mask) and SAM is no less sure of it: features that leak into a plinth ask for object and plinth. With
    clicks on what is not part of the object the box is not asked: features have shown not to part the two.
    """
    camera = view.camera
    points, others = [(point.x, point.y) for point in clicks], [(point.x, point.y) for point in outside]
    mask, score = photos.segment(camera, points=points, outside=others)
    by_point = view.from_photo(mask)
    places = [_pixel_of(view, point.x, point.y) for point in clicks]
    places = [(column, row) for column, row in places if view.covered[row, column]]
    if not places:
        return Seed(view, by_point, score, whole=False)
    clicked = [view.features[row, column] for column, row in places]
    # Several clicks mean several parts: the mask as a whole leads, and not one pixel of it.
    start = _if_agreed(clicked[0], view, by_point, settings) if len(clicks) == 1 else None
    seed = Seed(view, by_point, score, start, whole=len(clicks) > 1)
    if others:
        return seed
    areas = cv2.connectedComponents(view.like(np.stack(clicked), settings.cosine).astype(np.uint8))[1]
    instance = np.isin(areas, [areas[row, column] for column, row in places])
    rows, columns = np.nonzero(view.to_photo(instance))
    if len(rows) == 0:
        return seed
    box = (float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1))
    mask, second = photos.segment(camera, points=points if len(points) > 1 else (), box=box)
    by_box = view.from_photo(mask)
    if second < score or _likeness(by_box, instance) <= _likeness(by_point, instance):
        return seed
    start = _if_agreed(clicked[0], view, by_box, settings) if len(clicks) == 1 else None
    return Seed(view, by_box, second, start, whole=len(clicks) > 1)


def _if_agreed(clicked: Float32, view: View, mask: Mask, settings: SegmentSettings) -> Float32 | None:
    """Return the clicked feature when at least half of the mask is like it: a single pixel may lie on a seam."""
    features = view.features[mask & view.covered]
    return clicked if len(features) and (features @ clicked >= settings.cosine).mean() >= 0.5 else None


def _likeness(one: Mask, other: Mask) -> float:
    union = int((one | other).sum())
    return int((one & other).sum()) / union if union else 0.0


def _pixel_of(view: View, x: float, y: float) -> tuple[int, int]:
    """Return column and row of the view's frame that show a point of the photo."""
    spot = np.zeros((view.camera.height, view.camera.width), np.uint8)
    reach = max(2, round(1.5 * max(spot.shape) / max(view.frame.width, view.frame.height)))
    cv2.circle(spot, (int(x), int(y)), reach, 1, thickness=-1)
    rows, columns = np.nonzero(view.from_photo(spot > 0))
    if len(rows) == 0:
        raise PromptError(f"The click {x:g},{y:g} lies on the very rim of {view.camera.photo}. Click farther inside.")
    return int(round(float(columns.mean()))), int(round(float(rows.mean())))


def _from_box(prompt: BoxPrompt, view: View, photos: Photos) -> Seed:
    camera = view.camera
    left, right = np.clip([prompt.x0, prompt.x1], 0, camera.width)
    top, bottom = np.clip([prompt.y0, prompt.y1], 0, camera.height)
    outside = [(point.x, point.y) for point in prompt.excluded if point.photo == camera.photo]
    box = (float(left), float(top), float(right), float(bottom))
    mask, score = photos.segment(camera, outside=outside, box=box)
    return Seed(view, view.from_photo(mask), score)


def _from_text(
    prompt: TextPrompt,
    views: Views,
    photos: Photos,
    label_maps: Mapping[str, NDArray[np.int32]],
    settings: SegmentSettings,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
) -> list[Seed]:
    detector = detector_factory()
    check = detector.knows(prompt.text)
    if not check.known:
        raise PromptError(_outside_vocabulary(prompt.text, check.message, [word for word, _ in check.matches]))
    seeds = []
    # Segments that are there already are better regions than any box, and cost nothing.
    segmented = [camera for camera in views.cameras.cameras if camera.photo in label_maps]
    cameras = spread_cameras(segmented or views.cameras.cameras, settings.n_text_views)
    for number, camera in enumerate(cameras):
        if should_stop():
            raise Cancelled(f"Stopped while looking for {prompt.text!r}; no object was stored.")
        view = views.of(camera)
        for mask, score in _detections(detector, prompt.text, camera, photos, label_maps.get(camera.photo)):
            taken = view.from_photo(mask)
            if taken.any():
                seeds.append(Seed(view, taken, score))
        emit(
            Progress(
                "objects", 0.7 * (number + 1) / len(cameras), message=f"Looking for {prompt.text!r} ({detector.name})"
            )
        )
    return seeds


def _detections(
    detector: Detector, text: str, camera: Camera, photos: Photos, labels: NDArray[np.int32] | None
) -> list[tuple[Mask, float]]:
    """Return masks, in the photo's frame, and scores of what `text` names in one photo."""
    pixels = photos.pixels(camera)
    if labels is not None:
        return [(labels == found.region, found.score) for found in detector.detect(pixels, text, labels=labels)]
    scale = photos.scale(camera)
    found = [(detection.box, detection.score) for detection in detector.detect(pixels, text)]
    boxes = [(x0 / scale, y0 / scale, x1 / scale, y1 / scale) for (x0, y0, x1, y1), _ in found]
    return [(photos.segment(camera, box=box)[0], score) for box, (_, score) in zip(boxes, found, strict=True)]


def _outside_vocabulary(text: str, message: str, nearest: list[str]) -> str:
    sentence = message or f"The detector does not know {text!r}."
    missing = [word for word in nearest if word not in sentence]
    if missing:
        sentence = f"{sentence.rstrip('.')}. The nearest words it knows: {', '.join(nearest[:5])}."
    if "click" not in sentence.lower():
        sentence += " You can click on the object instead."
    return sentence
