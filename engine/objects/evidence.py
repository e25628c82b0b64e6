"""Mask evidence: masks in photos that may show the object of a prompt.

A mask is given by the user, drawn by SAM for a click or a box, or found by a text detector in several views or among
the groups of the scene.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled, PromptError
from ..events import Emit, Progress, StopCheck
from ..masks import mask_box, mask_iou
from ..scene import Camera
from .appearance import GroupAppearance
from .context import SegmentationContext
from .photos import Photos, SamFactory
from .prompts import BoxPrompt, ClickPrompt, MaskPrompt, Point, Prompt, TextPrompt, camera_of_prompt, load_mask
from .settings import SegmentSettings
from .views import View, Views, spread_cameras

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = [
    "DetectorFactory",
    "MaskEvidence",
    "Photos",
    "SamFactory",
    "evidence_of_clicks",
    "evidence_of_groups",
    "find_evidence",
]

DetectorFactory = Callable[[], "Detector"]

Mask = NDArray[np.bool_]
Float32 = NDArray[np.float32]

_MIN_GROUP_SCORE = 0.05  # chosen on museum_room, store_room
"""Smallest score, mean over the photos times the root of the prominence, with which a group is evidence of a text."""

_NEARLY_AS_GOOD = 0.9  # chosen on museum_room, store_room
"""Share of a group's score from which on a larger group around it is evidence too."""


@dataclass(frozen=True)
class MaskEvidence:
    """A mask in one view that may show the object of a prompt.

    Attributes
    ----------
    view : View
    mask : bool array of shape [h, w]
        In the frame of `view`.
    score : float
        Confidence, 0 to 1: of the detector for a text, SAM's estimate of its IoU for a click or a box, 1 for a given
        mask.
    clicked_feature : array of shape [D], float32, or None
        Feature of the clicked pixel, at unit length.
    given : bool
        The user drew the mask, so it is not refined.
    whole : bool
        The mask is expected to show the whole object, so that all parts of it count. The mask of a single click may
        leak into something else or show only a part; there the clicked feature decides.
    members : bool array of shape [N], or None
        The Gaussians that the mask shows, where they are known and need not be found by their features.
    """

    view: View
    mask: Mask
    score: float
    clicked_feature: Float32 | None = None
    given: bool = False
    whole: bool = True
    members: Mask | None = None


def find_evidence(
    prompt: Prompt,
    context: SegmentationContext,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
) -> list[MaskEvidence]:
    """Return masks that may show the object of `prompt`; at least one unless it is a text.

    Parameters
    ----------
    prompt : Prompt
    context : SegmentationContext
        A text detector chooses among the segments of its label maps, where there are some.
    settings : SegmentSettings
    detector_factory : callable
        Called only for a text.
    emit, should_stop
        See `engine.events`.

    Raises
    ------
    PromptError
        When no mask was found at a clicked point or in a box, and for a text that the detector does not know; the
        message then lists the nearest words that it knows.
    MaskError
        When a given mask cannot be used.
    Cancelled
        When `should_stop` returns True.
    """
    if isinstance(prompt, TextPrompt):
        return _from_text(prompt, context, settings, detector_factory(), emit, should_stop)
    views, photos = context.views, context.photos
    for point in prompt.excluded:
        camera_of_prompt(point, views.cameras)
    if isinstance(prompt, ClickPrompt):
        return evidence_of_clicks(prompt.clicks, prompt.excluded, context, settings)
    camera = camera_of_prompt(prompt, views.cameras)
    view = views.of(camera)
    if isinstance(prompt, MaskPrompt):
        mask = view.from_photo(load_mask(prompt.mask, camera))
        return [_require_mask(MaskEvidence(view, mask, 1.0, given=True))]
    return [_require_mask(_from_box(prompt, view, photos))]


def evidence_of_clicks(
    clicks: Sequence[Point], excluded: Sequence[Point], context: SegmentationContext, settings: SegmentSettings
) -> list[MaskEvidence]:
    """Return one mask for each clicked photo, from all clicks in it.

    Parameters
    ----------
    clicks : sequence of Point
        On the object.
    excluded : sequence of Point
        On what is not part of the object. SAM gets those in the same photo as background points.
    context : SegmentationContext
    settings : SegmentSettings

    Raises
    ------
    PromptError
        For a click outside of its photo, or where no mask was found.
    """
    views = context.views
    clicks_by_photo: dict[str, list[Point]] = {}
    for point in clicks:
        camera_of_prompt(point, views.cameras)
        clicks_by_photo.setdefault(point.photo, []).append(point)
    evidence = []
    for photo, points in clicks_by_photo.items():
        view = views.of(camera_of_prompt(points[0], views.cameras))
        outside = [point for point in excluded if point.photo == photo]
        evidence.append(_require_mask(_from_clicks(points, outside, view, context.photos, settings)))
    return evidence


def _require_mask(evidence: MaskEvidence) -> MaskEvidence:
    if not evidence.mask.any():
        photo = evidence.view.camera.photo
        raise PromptError(f"Nothing was found at that place of {photo}. Click on the middle of the object.")
    return evidence


def _from_clicks(
    clicks: Sequence[Point], outside: Sequence[Point], view: View, photos: Photos, settings: SegmentSettings
) -> MaskEvidence:
    """Return SAM's mask that best fits the connected area with features like those of the clicked pixels.

    SAM's answer to a single point is often only a part of the object. Therefore SAM is also prompted with the bounding
    box of that area. The second mask is used when it has a higher IoU with the area (the paper's best-fitting instance
    mask) and SAM's own score of it is no lower: features that leak into a plinth yield a box of object and plinth. With
    excluded clicks the box is not used, because the features do not separate the object from what was excluded.
    """
    camera = view.camera
    points, background = [(point.x, point.y) for point in clicks], [(point.x, point.y) for point in outside]
    mask, point_score = photos.segment(camera, points=points, outside=background)
    point_mask = view.from_photo(mask)
    places = [_pixel_of(view, point.x, point.y) for point in clicks]
    places = [(column, row) for column, row in places if view.covered[row, column]]
    if not places:
        return MaskEvidence(view, point_mask, point_score, whole=False)
    clicked = [view.features[row, column] for column, row in places]
    # Several clicks mean several parts, so the mask as a whole decides and not the feature of one pixel.
    single_click = len(clicks) == 1
    feature = _typical_feature(clicked[0], view, point_mask, settings) if single_click else None
    evidence = MaskEvidence(view, point_mask, point_score, feature, whole=not single_click)
    if background:
        return evidence
    areas = cv2.connectedComponents(view.like(np.stack(clicked), settings.cosine).astype(np.uint8))[1]
    instance = np.isin(areas, [areas[row, column] for column, row in places])
    box = mask_box(view.to_photo(instance))
    if box is None:
        return evidence
    mask, box_score = photos.segment(
        camera,
        points=() if single_click else points,
        box=(float(box[0]), float(box[1]), float(box[2]), float(box[3])),
    )
    box_mask = view.from_photo(mask)
    if box_score < point_score or mask_iou(box_mask, instance) <= mask_iou(point_mask, instance):
        return evidence
    feature = _typical_feature(clicked[0], view, box_mask, settings) if single_click else None
    return MaskEvidence(view, box_mask, box_score, feature, whole=not single_click)


def _typical_feature(clicked: Float32, view: View, mask: Mask, settings: SegmentSettings) -> Float32 | None:
    """Return the clicked feature if at least half of the mask is like it: a single pixel may lie on a seam."""
    features = view.features[mask & view.covered]
    return clicked if len(features) and (features @ clicked >= settings.cosine).mean() >= 0.5 else None


def _pixel_of(view: View, x: float, y: float) -> tuple[int, int]:
    """Return column and row of the pixel in the view's frame that shows a point of the photo."""
    spot = np.zeros((view.camera.height, view.camera.width), np.uint8)
    radius = max(2, round(1.5 * max(spot.shape) / max(view.frame.width, view.frame.height)))
    cv2.circle(spot, (int(x), int(y)), radius, 1, thickness=-1)
    rows, columns = np.nonzero(view.from_photo(spot > 0))
    if len(rows) == 0:
        raise PromptError(f"The click {x:g},{y:g} lies on the very rim of {view.camera.photo}. Click farther inside.")
    return int(round(float(columns.mean()))), int(round(float(rows.mean())))


def _from_box(prompt: BoxPrompt, view: View, photos: Photos) -> MaskEvidence:
    camera = view.camera
    left, right = np.clip([prompt.x0, prompt.x1], 0, camera.width)
    top, bottom = np.clip([prompt.y0, prompt.y1], 0, camera.height)
    outside = [(point.x, point.y) for point in prompt.excluded if point.photo == camera.photo]
    box = (float(left), float(top), float(right), float(bottom))
    mask, score = photos.segment(camera, outside=outside, box=box)
    return MaskEvidence(view, view.from_photo(mask), score)


def _from_text(
    prompt: TextPrompt,
    context: SegmentationContext,
    settings: SegmentSettings,
    detector: Detector,
    emit: Emit,
    should_stop: StopCheck,
) -> list[MaskEvidence]:
    check = detector.check_prompt(prompt.text)
    if not check.known:
        raise PromptError(_unknown_text(prompt.text, check.message, [word for word, _ in check.matches]))
    evidence = []
    # Existing segments are better regions than any box, and cost nothing.
    views, label_maps = context.views, context.label_maps
    segmented = [camera for camera in views.cameras.cameras if camera.photo in label_maps]
    cameras = spread_cameras(segmented or views.cameras.cameras, settings.n_text_views)
    for number, camera in enumerate(cameras):
        if should_stop():
            raise Cancelled(f"Stopped while looking for {prompt.text!r}; no object was stored.")
        view = views.of(camera)
        for photo_mask, score in _detect(detector, prompt.text, camera, context.photos, label_maps.get(camera.photo)):
            mask = view.from_photo(photo_mask)
            if mask.any():
                evidence.append(MaskEvidence(view, mask, score))
        emit(
            Progress(
                "objects", 0.7 * (number + 1) / len(cameras), message=f"Looking for {prompt.text!r} ({detector.name})"
            )
        )
    return evidence


def _detect(
    detector: Detector, text: str, camera: Camera, photos: Photos, labels: NDArray[np.int32] | None
) -> list[tuple[Mask, float]]:
    """Return masks, in the pixels of the photo, and scores of all detections of `text` in one photo."""
    pixels = photos.pixels(camera)
    if labels is not None:
        return [(labels == found.region, found.score) for found in detector.detect(pixels, text, labels=labels)]
    scale = photos.scale(camera)
    found = [(detection.box, detection.score) for detection in detector.detect(pixels, text)]
    boxes = [(x0 / scale, y0 / scale, x1 / scale, y1 / scale) for (x0, y0, x1, y1), _ in found]
    return [(photos.segment(camera, box=box)[0], score) for box, (_, score) in zip(boxes, found, strict=True)]


def _unknown_text(text: str, message: str, nearest: list[str]) -> str:
    sentence = message or f"The detector does not know {text!r}."
    missing = [word for word in nearest if word not in sentence]
    if missing:
        sentence = f"{sentence.rstrip('.')}. The nearest words it knows: {', '.join(nearest[:5])}."
    if "click" not in sentence.lower():
        sentence += " You can click on the object instead."
    return sentence


def evidence_of_groups(
    text: str, appearance: GroupAppearance, views: Views, detector: Detector, max_count: int
) -> list[MaskEvidence]:
    """Return prominent groups of the scene that look like `text`, each in the photo that shows it largest.

    A part of an object may match the text as well as the whole object, and be as prominent. Each selected group is
    therefore accompanied by the largest group around it whose score is at least 0.9 of its own. A group that contains
    a better one, or lies inside of one, is not selected by itself.

    Parameters
    ----------
    text : str
    appearance : GroupAppearance
    views : Views
    detector : Detector
        The one that described the groups.
    max_count : int
        Largest number of masks.

    Raises
    ------
    PromptError
        When the detector does not know the text.
    """
    if len(appearance.group) == 0:
        return []
    scores = np.asarray(detector.score_descriptions(appearance.described, text), np.float64)
    groups = appearance.hierarchy.groups
    n_sightings = np.bincount(appearance.group, minlength=len(groups))
    mean = np.bincount(appearance.group, weights=scores, minlength=len(groups)) / np.maximum(n_sightings, 1)
    value = mean * np.sqrt(appearance.hierarchy.prominence)
    selected: list[int] = []
    for group in np.argsort(-value, kind="stable"):
        if len(selected) >= max_count or value[group] < _MIN_GROUP_SCORE:
            break
        first, stop = groups[group]
        around = (groups[:, 0] <= first) & (groups[:, 1] >= stop)
        inside = (groups[:, 0] >= first) & (groups[:, 1] <= stop)
        if (around | inside)[selected].any():
            continue
        nearly_as_good = np.flatnonzero(around & (value >= _NEARLY_AS_GOOD * value[group]))
        largest = nearly_as_good[np.argmax(groups[nearly_as_good, 1] - groups[nearly_as_good, 0])]
        selected += [int(group)] if largest == group else [int(group), int(largest)]
    cameras = {camera.photo: camera for camera in views.cameras.cameras}
    evidence = []
    for group in selected[:max_count]:
        sightings = np.flatnonzero(appearance.group == group)
        masks = {
            int(i): appearance.hierarchy.within(appearance.group_maps[appearance.photo[i]], group) for i in sightings
        }
        largest = max(masks, key=lambda i: int(masks[i].sum()))
        view = views.of(cameras[appearance.photo[largest]])
        members = appearance.hierarchy.members(group)
        evidence.append(MaskEvidence(view, masks[largest], float(scores[sightings].max()), members=members))
    return evidence
