"""Where evidence comes from: every kind of prompt becomes masks in views (`engine.objects.votes.MaskEvidence`).

A mask is given by the user, drawn by SAM for a click or a box, or found by a text detector in several views or among
the groups of the scene.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled, PromptError
from ..events import Emit, Progress, StopCheck
from ..scene import Camera, CameraSet
from .appearance import GroupAppearance
from .connected import connected_parts
from .context import SegmentationContext
from .photos import Photos, SamFactory
from .prompts import BoxPrompt, ClickPrompt, MaskPrompt, Point, Prompt, TextPrompt, camera_of_prompt, load_mask
from .settings import SegmentSettings
from .views import View, Views, spread_cameras
from .votes import MaskEvidence, count_votes

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = [
    "DetectorFactory",
    "Photos",
    "SamFactory",
    "clicks_by_photo",
    "evidence_of_clicks",
    "evidence_of_exclusions",
    "evidence_of_groups",
    "excluded_evidence",
    "find_evidence",
    "nothing_behind",
    "nothing_found",
    "pixel_of",
    "require_mask",
]

DetectorFactory = Callable[[], "Detector"]

Mask = NDArray[np.bool_]

_CLICK_COSINE = 0.7  # published: Dahaghin et al. 2024
"""Smallest cosine of a Gaussian's feature with that of a clicked pixel at which it may belong to the object."""

_MIN_GROUP_SCORE = 0.05  # chosen on museum_room, store_room
"""Smallest score, mean over the photos times the root of the prominence, with which a group is evidence of a text."""

_NEARLY_AS_GOOD = 0.9  # chosen on museum_room, store_room
"""Share of a group's score from which on a larger group around it is evidence too."""


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
    views = context.views
    excluded = excluded_evidence(prompt, context)
    if isinstance(prompt, ClickPrompt):
        return evidence_of_clicks(prompt.clicks, prompt.excluded, context) + excluded
    camera = camera_of_prompt(prompt, views.cameras)
    view = views.of(camera)
    if isinstance(prompt, MaskPrompt):
        mask = view.from_photo(load_mask(prompt.mask, camera))
        return [require_mask(MaskEvidence(view, mask, 1.0, given=True)), *excluded]
    return [require_mask(_from_box(prompt, view, context.photos)), *excluded]


def excluded_evidence(prompt: ClickPrompt | BoxPrompt | MaskPrompt, context: SegmentationContext) -> list[MaskEvidence]:
    """Return SAM's masks of the excluded clicks of a prompt; errors as of `evidence_of_exclusions`."""
    clicks = prompt.clicks if isinstance(prompt, ClickPrompt) else ()
    return evidence_of_exclusions(prompt.excluded, clicks, context)


def evidence_of_exclusions(
    excluded: Sequence[Point], clicks: Sequence[Point], context: SegmentationContext
) -> list[MaskEvidence]:
    """Return one excluded mask for each photo of the clicks `excluded`, with `clicks` as SAM's background points.

    Raises
    ------
    PromptError
        For a click outside of its photo, or where no mask was found.
    """
    evidence = []
    for points in clicks_by_photo(excluded, context.views.cameras):
        view = context.views.of(camera_of_prompt(points[0], context.views.cameras))
        mask, score = _segment_clicks(points, clicks, view, context.photos)
        evidence.append(require_mask(MaskEvidence(view, mask, score, excluded=True)))
    return evidence


def evidence_of_clicks(
    clicks: Sequence[Point], excluded: Sequence[Point], context: SegmentationContext
) -> list[MaskEvidence]:
    """Return one mask for each clicked photo, from all clicks in it.

    SAM's mask of a click is often only a part of the object. Known are therefore the Gaussians with a feature like that
    of a clicked pixel, as far as they are connected to what the mask shows.

    Parameters
    ----------
    clicks : sequence of Point
        On the object.
    excluded : sequence of Point
        On what is not part of the object. SAM gets those in the same photo as background points.
    context : SegmentationContext

    Raises
    ------
    PromptError
        For a click outside of its photo, or where no mask was found.
    """
    views = context.views
    evidence = []
    for points in clicks_by_photo(clicks, views.cameras):
        view = views.of(camera_of_prompt(points[0], views.cameras))
        mask, score = _segment_clicks(points, excluded, view, context.photos)
        item = require_mask(MaskEvidence(view, mask, score))
        evidence.append(replace(item, members=_similar_gaussians(points, item, views)))
    return evidence


def _similar_gaussians(clicks: Sequence[Point], item: MaskEvidence, views: Views) -> Mask | None:
    """Return the Gaussians with features like those of clicked pixels, connected to a mask; None if there are none."""
    places = [pixel_of(item.view, point.x, point.y) for point in clicks]
    clicked = np.array([item.view.features[row, column] for column, row in places if item.view.covered[row, column]])
    if len(clicked) == 0:
        return None
    similar = np.flatnonzero((views.directions @ clicked.T).max(axis=1) >= _CLICK_COSINE)
    weights = count_votes(views, item, np.zeros(len(views.scene), np.float32)).inside
    members = np.zeros(len(views.scene), bool)
    members[similar[connected_parts(views.scene.gaussians.means[similar], weights[similar])]] = True
    return members if members.any() else None


def clicks_by_photo(clicks: Sequence[Point], cameras: CameraSet) -> list[list[Point]]:
    """Return the clicks of each photo; raises `PromptError` for a click outside of its photo."""
    by_photo: dict[str, list[Point]] = {}
    for point in clicks:
        camera_of_prompt(point, cameras)
        by_photo.setdefault(point.photo, []).append(point)
    return list(by_photo.values())


def require_mask(evidence: MaskEvidence) -> MaskEvidence:
    """Return `evidence`; raises `PromptError` when its mask is empty."""
    if not evidence.mask.any():
        photo = evidence.view.camera.photo
        raise PromptError(f"Nothing was found at that place of {photo}. Click on the middle of the object.")
    return evidence


def _segment_clicks(
    clicks: Sequence[Point], outside: Sequence[Point], view: View, photos: Photos
) -> tuple[Mask, float]:
    """Return SAM's mask of clicks in the frame of `view`, and its score."""
    photo = view.camera.photo
    mask, score = photos.segment(
        view.camera,
        points=[(point.x, point.y) for point in clicks],
        outside=[(point.x, point.y) for point in outside if point.photo == photo],
    )
    return view.from_photo(mask), score


def pixel_of(view: View, x: float, y: float) -> tuple[int, int]:
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


def nothing_found(text: str, context: SegmentationContext, settings: SegmentSettings) -> PromptError:
    """Return the error for a text that the detector knows and finds in no photo."""
    n_photos = min(settings.n_text_views, len(context.label_maps) or len(context.views.cameras.cameras))
    return PromptError(
        f"{text!r} was not found in {n_photos} photos. Use another word, or click on the object instead."
    )


def nothing_behind() -> PromptError:
    """Return the error for evidence that shows no Gaussian."""
    return PromptError(
        "No Gaussian of the scene lies behind what was found in the photos. Choose another photo or prompt."
    )


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
