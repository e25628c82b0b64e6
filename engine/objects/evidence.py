"""Where evidence comes from: every kind of prompt becomes masks in views (`engine.objects.votes.MaskEvidence`).

A mask is given by the user, drawn by SAM for a box, or that of the segment under a click. What a text means is found
among the proposals (`engine.objects.proposals`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import PromptError
from ..scene import CameraSet
from .connected import connected_parts
from .context import SegmentationContext
from .photos import Photos
from .prompts import BoxPrompt, ClickPrompt, MaskPrompt, Point, camera_of_prompt, load_mask
from .settings import SegmentSettings
from .views import View, Views
from .votes import THRESHOLD, MaskEvidence, count_votes

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = [
    "DetectorFactory",
    "clicks_by_photo",
    "evidence_of_clicks",
    "evidence_of_exclusions",
    "evidence_of_places",
    "excluded_evidence",
    "find_evidence",
    "nothing_behind",
    "nothing_found",
    "pixel_of",
    "require_known",
    "require_mask",
]

DetectorFactory = Callable[[], "Detector"]

Mask = NDArray[np.bool_]

_CLICK_COSINE = 0.7  # published: Dahaghin et al. 2024
"""Smallest cosine of a Gaussian's feature with that of a clicked pixel at which it may belong to the object."""


def find_evidence(prompt: ClickPrompt | BoxPrompt | MaskPrompt, context: SegmentationContext) -> list[MaskEvidence]:
    """Return masks that show the object of `prompt`, or what does not belong to it; at least one.

    Raises
    ------
    PromptError
        When no mask was found at a clicked point or in a box.
    MaskError
        When a given mask cannot be used.
    """
    views = context.views
    excluded = excluded_evidence(prompt, context)
    if isinstance(prompt, ClickPrompt):
        return evidence_of_clicks(prompt.clicks, context) + excluded
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
        outside = [(point.x, point.y) for point in clicks if point.photo == points[0].photo]
        mask, score = context.photos.segment(
            view.camera, points=[(point.x, point.y) for point in points], outside=outside
        )
        evidence.append(require_mask(MaskEvidence(view, view.from_photo(mask), score, excluded=True)))
    return evidence


def evidence_of_clicks(clicks: Sequence[Point], context: SegmentationContext) -> list[MaskEvidence]:
    """Return one mask for each clicked photo, from all clicks in it; SAM is not asked.

    Parameters
    ----------
    clicks : sequence of Point
        On the object.
    context : SegmentationContext

    Raises
    ------
    PromptError
        For a click outside of its photo.
    """
    views = context.views
    evidence = []
    for points in clicks_by_photo(clicks, views.cameras):
        view = views.of(camera_of_prompt(points[0], views.cameras))
        evidence.append(evidence_of_places([(point.x, point.y) for point in points], view, context))
    return evidence


def evidence_of_places(places: Sequence[tuple[float, float]], view: View, context: SegmentationContext) -> MaskEvidence:
    """Return what clicked places of a view show: where the photo has segments, those under the clicks.

    A segment is often only a part of the object. Known are therefore the Gaussians with a feature like that of a
    clicked pixel, as far as they are connected to what the mask shows.

    Parameters
    ----------
    places : sequence of (float, float)
        x, y in pixels of the photo of `view`.
    view : View
        Of a photo, or of any other camera (`Views.from_anywhere`).
    context : SegmentationContext
    """
    pixels = [pixel_of(view, x, y) for x, y in places]
    columns, rows = np.transpose(pixels)
    mask = np.zeros(view.within.shape, bool)
    mask[rows, columns] = True
    if view.camera.photo in context.label_maps:
        labels = view.labels_from_photo(context.label_maps[view.camera.photo])
        mask |= np.isin(labels, labels[rows, columns]) & (labels > 0)
    else:
        mask = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    item = MaskEvidence(view, mask & view.within, 1.0)
    members = _similar_gaussians(pixels, item, context.views)
    if members is None:
        return item
    shown = context.views.visible_share(view, members) > THRESHOLD
    return replace(item, mask=item.mask | (shown & view.within), members=members)


def _similar_gaussians(pixels: Sequence[tuple[int, int]], item: MaskEvidence, views: Views) -> Mask | None:
    """Return the Gaussians with features like those of clicked pixels, connected to a mask; None if there are none."""
    clicked = np.array([item.view.features[row, column] for column, row in pixels if item.view.covered[row, column]])
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


def nothing_behind() -> PromptError:
    """Return the error for evidence that shows no Gaussian."""
    return PromptError(
        "No Gaussian of the scene lies behind what was found in the photos. Choose another photo or prompt."
    )


def require_known(text: str, detector: Detector) -> None:
    """Raise `PromptError` for a text that the detector does not know; the message lists the nearest words it knows."""
    check = detector.check_prompt(text)
    if not check.known:
        raise PromptError(_unknown_text(text, check.message, [word for word, _ in check.matches]))


def _unknown_text(text: str, message: str, nearest: list[str]) -> str:
    sentence = message or f"The detector does not know {text!r}."
    missing = [word for word in nearest if word not in sentence]
    if missing:
        sentence = f"{sentence.rstrip('.')}. The nearest words it knows: {', '.join(nearest[:5])}."
    if "click" not in sentence.lower():
        sentence += " You can click on the object instead."
    return sentence


def nothing_found(text: str, context: SegmentationContext, settings: SegmentSettings) -> PromptError:
    """Return the error for a text that the detector knows and finds in no photo."""
    n_photos = min(settings.n_text_views, len(context.label_maps) or len(context.views.cameras.cameras))
    return PromptError(
        f"{text!r} was not found in {n_photos} photos. Use another word, or click on the object instead."
    )
