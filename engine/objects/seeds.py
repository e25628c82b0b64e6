"""From a prompt to masks in photos: given, by SAM from a click or box, or by a text detector in several views."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from ..cameras.camera import Camera
from ..errors import Cancelled, PromptError
from ..events import Emit, Progress, StopCheck
from ..photos.pixels import load_pixels
from .prompts import BoxPrompt, ClickPrompt, MaskPrompt, Prompt, TextPrompt, camera_of_prompt, load_mask
from .settings import SegmentSettings
from .views import View, Views, spread_cameras

if TYPE_CHECKING:
    from ..grounding.detector import Detector
    from ..masks.sam import Embedding, SegmentAnything

__all__ = ["DetectorFactory", "Photos", "SamFactory", "Seed", "find_seeds"]

DetectorFactory = Callable[[], "Detector"]
SamFactory = Callable[[], "SegmentAnything"]

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
    """

    view: View
    mask: Mask
    score: float
    start: Float32 | None = None
    given: bool = False
    whole: bool = True


class Photos:
    """Photos at the size the models see, each encoded by SAM at most once."""

    def __init__(self, folder: Path, side: int, sam_factory: SamFactory) -> None:
        self._folder, self._side, self._sam_factory = folder, side, sam_factory
        self._sam: SegmentAnything | None = None
        self._embeddings: dict[str, Embedding] = {}

    def pixels(self, camera: Camera) -> NDArray[np.uint8]:
        """Return the photo, uint8 [H, W, 3]."""
        return load_pixels(self._folder / camera.photo, max_side=self._side)

    def segment(
        self,
        camera: Camera,
        pixels: NDArray[np.uint8],
        *,
        point: tuple[float, float] | None = None,
        box: tuple[float, float, float, float] | None = None,
    ) -> tuple[Mask, float]:
        """Return SAM's mask and its guess of the IoU for a point or box in the pixels of `pixels`."""
        if self._sam is None:
            self._sam = self._sam_factory()
        if camera.photo not in self._embeddings:
            self._embeddings = {camera.photo: self._sam.encode(pixels)}
        points = np.asarray([point] if point is not None else np.zeros((0, 2)), np.float32)
        found = self._sam.predict(
            self._embeddings[camera.photo],
            points if len(points) else None,
            np.ones(len(points), np.float32) if len(points) else None,
            None if box is None else np.asarray(box, np.float32),
        )
        return found.mask, float(np.clip(found.iou, 0, 1))


def find_seeds(
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
    """Return masks that may show what `prompt` asks for, at least one.

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
        When nothing was found; for a text outside of the detector's words with the nearest it knows.
    MaskError
        When a given mask cannot be used.
    Cancelled
        When `should_stop` says so.
    """
    if isinstance(prompt, TextPrompt):
        return _from_text(prompt, views, photos, label_maps, settings, detector_factory, emit, should_stop)
    camera = camera_of_prompt(prompt, views.cameras)
    view = views.of(camera)
    if isinstance(prompt, MaskPrompt):
        seed = Seed(view, view.from_photo(load_mask(prompt.mask, camera)), 1.0, given=True)
    elif isinstance(prompt, ClickPrompt):
        seed = _from_click(prompt, view, photos, settings)
    else:
        seed = _from_box(prompt, view, photos)
    if not seed.mask.any():
        raise PromptError(f"Nothing was found at that place of {camera.photo}. Click on the middle of the object.")
    return [seed]


def _from_click(prompt: ClickPrompt, view: View, photos: Photos, settings: SegmentSettings) -> Seed:
    """Return SAM's mask that best fits the instance the features show at the clicked pixel.

    SAM's answer to a single point is often only a part of the object. The box of the pixels with a feature like the
    clicked one asks it again. The second answer is taken when it is more like those pixels (the paper's best-fitting
    instance mask) and SAM is no less sure of it: features that leak into a plinth ask for object and plinth.
    """
    camera = view.camera
    pixels = photos.pixels(camera)
    scale = pixels.shape[1] / camera.width
    mask, score = photos.segment(camera, pixels, point=(prompt.x * scale, prompt.y * scale))
    by_point = view.from_photo(mask)
    column, row = _pixel_of(view, prompt.x, prompt.y)
    if not view.covered[row, column]:
        return Seed(view, by_point, score, whole=False)
    clicked = view.features[row, column]
    areas = cv2.connectedComponents(view.like(clicked[None], settings.cosine).astype(np.uint8))[1]
    instance = areas == areas[row, column]
    seed = Seed(view, by_point, score, _if_agreed(clicked, view, by_point, settings), whole=False)
    rows, columns = np.nonzero(view.to_photo(instance))
    if len(rows) == 0:
        return seed
    box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]) * scale
    mask, second = photos.segment(camera, pixels, box=(float(box[0]), float(box[1]), float(box[2]), float(box[3])))
    by_box = view.from_photo(mask)
    if second < score or _likeness(by_box, instance) <= _likeness(by_point, instance):
        return seed
    return Seed(view, by_box, second, _if_agreed(clicked, view, by_box, settings), whole=False)


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
    pixels = photos.pixels(camera)
    scale = pixels.shape[1] / camera.width
    left, right = np.clip([prompt.x0, prompt.x1], 0, camera.width)
    top, bottom = np.clip([prompt.y0, prompt.y1], 0, camera.height)
    box = (float(left * scale), float(top * scale), float(right * scale), float(bottom * scale))
    mask, score = photos.segment(camera, pixels, box=box)
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
    if not seeds:
        raise PromptError(
            f"{prompt.text!r} was not found in {len(cameras)} photos. Use another word, or click on the object instead."
        )
    return seeds


def _detections(
    detector: Detector, text: str, camera: Camera, photos: Photos, labels: NDArray[np.int32] | None
) -> list[tuple[Mask, float]]:
    """Return masks, in the photo's frame, and scores of what `text` names in one photo."""
    pixels = photos.pixels(camera)
    if labels is not None:
        return [(labels == found.region, found.score) for found in detector.detect(pixels, text, labels=labels)]
    return [(photos.segment(camera, pixels, box=found.box)[0], found.score) for found in detector.detect(pixels, text)]


def _outside_vocabulary(text: str, message: str, nearest: list[str]) -> str:
    sentence = message or f"The detector does not know {text!r}."
    missing = [word for word in nearest if word not in sentence]
    if missing:
        sentence = f"{sentence.rstrip('.')}. The nearest words it knows: {', '.join(nearest[:5])}."
    if "click" not in sentence.lower():
        sentence += " You can click on the object instead."
    return sentence
