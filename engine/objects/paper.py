"""The published method: one feature for the mask of a prompt, all Gaussians near it, then their convex hull.

Dahaghin et al., "Gaussian Heritage" (2024). It shares with `engine.objects.segment` how boxes and masks become
evidence, and nothing else. docs/paper.md lists where the text, its released code and this module differ.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from ..errors import Cancelled, PromptError
from ..events import Emit, Progress, StopCheck, part_of
from ..masks import mask_box
from ..pictures import normalized
from ..scene import Camera
from .connected import connected_parts
from .context import SegmentationContext
from .evidence import (
    DetectorFactory,
    clicks_by_photo,
    excluded_evidence,
    find_evidence,
    nothing_behind,
    nothing_found,
    pixel_of,
    require_known,
    require_mask,
)
from .found import FoundObject, fit_of, overlap
from .graph import bounded
from .lifting import Levels
from .photos import Photos
from .prompts import ClickPrompt, Point, Prompt, TextPrompt, camera_of_prompt
from .settings import PaperSettings
from .views import View, Views, erode_mask, spread_cameras
from .votes import BELOW_HALF, THRESHOLD, MaskEvidence, count_votes

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = ["find_objects_of_paper"]

log = logging.getLogger(__name__)

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_N_DIRECTION_ROUNDS = 3  # chosen on museum_room
"""Times that the outliers of a mean direction are removed."""


def find_objects_of_paper(
    context: SegmentationContext,
    prompt: Prompt,
    settings: PaperSettings,
    *,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
) -> list[FoundObject]:
    """Return the objects that `prompt` asks for, the best first; parameters and errors as of `find_objects`."""
    views = context.views
    if isinstance(prompt, ClickPrompt):
        evidence = [
            _from_clicks(points, prompt.excluded, context, settings)
            for points in clicks_by_photo(prompt.clicks, views.cameras)
        ]
    elif isinstance(prompt, TextPrompt):
        evidence = _from_text(prompt, context, settings, detector_factory(), emit, should_stop)
    else:
        evidence = find_evidence(prompt, context)
    shown = [item for item in evidence if not item.excluded]
    if isinstance(prompt, TextPrompt) and not shown:
        raise nothing_found(prompt.text, context, settings)
    candidates = _candidates(
        views, shown, settings.same_object, lambda item: _lift(views, item, prompt, settings), should_stop
    )
    if not candidates:
        raise nothing_behind()
    scored = [(candidate.evidence[0].score, candidate) for candidate in candidates]
    if isinstance(prompt, TextPrompt):
        searched = {item.view.camera.photo for item in shown}
        scored = sorted(((_agreement(views, one, searched), one) for one in candidates), key=lambda pair: -pair[0])
    excluded = [] if isinstance(prompt, TextPrompt) else excluded_evidence(prompt, context)
    removed = _shown_by(views, excluded)
    found: list[FoundObject] = []
    for number, (score, candidate) in enumerate(scored):
        if len(found) == settings.max_objects or score < settings.relative_score * scored[0][0]:
            break
        membership = _completed(views, candidate.membership, settings)
        membership = np.where(removed, np.minimum(membership, BELOW_HALF), membership)
        same = any(overlap(membership, other.membership) > settings.same_object for other in found)
        if not same and (membership >= THRESHOLD).any():
            evidence_of = tuple(candidate.evidence)
            found.append(FoundObject(membership, score, candidate.fit, evidence_of, Levels((membership,))))
        part_of(emit, 1, 2)(Progress("objects", (number + 1) / len(scored), message="Isolating"))
    if not found:
        raise PromptError("Nothing is left of the object: the excluded clicks removed all of it. Click elsewhere.")
    return found


@dataclass
class _Candidate:
    """Mask evidence that shows the same object.

    Attributes
    ----------
    membership : array of shape [N], float32
        Of the first evidence.
    evidence : list of MaskEvidence
        The best first.
    fit : float
        IoU of the first mask with the candidate rendered in the same view.
    """

    membership: Float32
    evidence: list[MaskEvidence]
    fit: float

    def add(self, item: MaskEvidence, membership: Float32, fit: float, *, better: bool) -> None:
        """Add evidence that shows the same object; `better` evidence becomes the first."""
        if better:
            self.membership, self.fit = membership, fit
            self.evidence.insert(0, item)
        else:
            self.evidence.append(item)


def _candidates(
    views: Views,
    evidence: Sequence[MaskEvidence],
    same_object: float,
    lift: Callable[[MaskEvidence], Float32 | None],
    should_stop: StopCheck,
) -> list[_Candidate]:
    """Lift each mask to the Gaussians and merge what shows the same ones, led by the mask with the best fit.

    Two masks show the same object when their Gaussians overlap by more than `same_object` of the smaller one.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """
    candidates: list[_Candidate] = []
    for item in sorted(evidence, key=lambda item: -item.score):
        if should_stop():
            raise Cancelled("Stopped while isolating; no object was stored.")
        membership = lift(item)
        if membership is None:
            continue
        fit = fit_of(views, item.view, item.mask, membership)
        same = next((c for c in candidates if overlap(c.membership, membership) > same_object), None)
        if same is None:
            candidates.append(_Candidate(membership, [item], fit))
        else:
            same.add(item, membership, fit, better=item.score * fit > same.evidence[0].score * same.fit)
    return candidates


def _from_text(
    prompt: TextPrompt,
    context: SegmentationContext,
    settings: PaperSettings,
    detector: Detector,
    emit: Emit,
    should_stop: StopCheck,
) -> list[MaskEvidence]:
    """Return the masks that the detector finds in several photos, among their segments where there are some."""
    require_known(prompt.text, detector)
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
        text = f"Looking for {prompt.text!r} ({detector.name})"
        part_of(emit, 0, 2)(Progress("objects", (number + 1) / len(cameras), message=text))
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


def _from_clicks(
    clicks: Sequence[Point], excluded: Sequence[Point], context: SegmentationContext, settings: PaperSettings
) -> MaskEvidence:
    """Return SAM's mask of the clicks, or of the box around what has features like theirs: that with the higher score.

    With excluded clicks in the photo it is always the first, which alone leaves them out.
    """
    view = context.views.of(camera_of_prompt(clicks[0], context.views.cameras))
    points = [(point.x, point.y) for point in clicks]
    outside = [(point.x, point.y) for point in excluded if point.photo == view.camera.photo]
    mask, score = context.photos.segment(view.camera, points=points, outside=outside)
    evidence = MaskEvidence(view, view.from_photo(mask), score)
    boxed = None if outside else _segment_similar(clicks, view, context.photos, settings.cosine)
    return require_mask(MaskEvidence(view, *boxed) if boxed is not None and boxed[1] >= score else evidence)


def _segment_similar(clicks: Sequence[Point], view: View, photos: Photos, cosine: float) -> tuple[Mask, float] | None:
    """Return SAM's mask of the box around the connected area with features like those of the clicked pixels.

    Parameters
    ----------
    clicks : sequence of Point
        In the photo of `view`.
    view : View
    photos : Photos
    cosine : float
        Smallest cosine of a pixel's feature with that of a clicked pixel.

    Returns
    -------
    (bool array of shape [h, w], float), or None
        The mask in the frame of `view`, and its score. None where no Gaussian covers a clicked pixel.
    """
    places = [pixel_of(view, point.x, point.y) for point in clicks]
    places = [(column, row) for column, row in places if view.covered[row, column]]
    if not places:
        return None
    clicked = np.stack([view.features[row, column] for column, row in places])
    similar = ((view.features @ clicked.T).max(axis=-1) >= cosine) & view.covered
    areas = cv2.connectedComponents(similar.astype(np.uint8))[1]
    box = mask_box(view.to_photo(np.isin(areas, [areas[row, column] for column, row in places])))
    if box is None:
        return None
    left, top, right, bottom = (float(side) for side in box)
    mask, score = photos.segment(view.camera, box=(left, top, right, bottom))
    return view.from_photo(mask), score


def _lift(views: Views, item: MaskEvidence, prompt: Prompt, settings: PaperSettings) -> Float32 | None:
    """Return the Gaussians with features like the mask's that are connected to what it shows; None without any."""
    view, mask = item.view, item.mask
    inner = erode_mask(mask, settings.erode_pixels) & view.covered
    if not inner.any():
        inner = mask & view.covered
    clicks = (
        [point for point in prompt.clicks if point.photo == view.camera.photo]
        if isinstance(prompt, ClickPrompt)
        else []
    )
    start = _clicked_feature(view, inner, clicks[0], settings) if len(clicks) == 1 else None
    direction = mean_direction(view.features[inner], start=start, cosine=settings.cosine)
    if direction is None:
        return None
    membership = calibrated(views.directions @ direction, settings.cosine)
    members = np.flatnonzero(membership >= THRESHOLD)
    weights = count_votes(views, item, membership).inside
    connected = np.zeros(len(membership), bool)
    connected[members[connected_parts(views.scene.gaussians.means[members], weights[members])]] = True
    membership = np.where(connected, membership, np.minimum(membership, BELOW_HALF))
    return bounded(membership, views.scene.gaussians.means) if connected.any() else None


def _shown_by(views: Views, evidence: Sequence[MaskEvidence]) -> Mask:
    """Return the Gaussians that lie behind any of the masks more than beside it, bool [N]."""
    shown = np.zeros(len(views.scene), bool)
    for item in evidence:
        votes = count_votes(views, item, shown.astype(np.float32))
        shown |= (votes.inside >= THRESHOLD) & (votes.inside > votes.outside)
    return shown


def _clicked_feature(view: View, inner: Mask, click: Point, settings: PaperSettings) -> Float32 | None:
    """Return the clicked feature if at least half of the mask is like it: a single pixel may lie on a seam."""
    column, row = pixel_of(view, click.x, click.y)
    features = view.features[inner]
    clicked = view.features[row, column]
    return clicked if len(features) and (features @ clicked >= settings.cosine).mean() >= THRESHOLD else None


def _completed(views: Views, membership: Float32, settings: PaperSettings) -> Float32:
    """Return the membership with the convex hull of the object filled in at 0.5."""
    means = views.scene.gaussians.means
    corners = means[membership >= THRESHOLD]
    if settings.outlier_iqr is not None:
        corners = corners[within_quartiles(corners, settings.outlier_iqr)]
    return np.where(inside_hull(corners, means), np.maximum(membership, THRESHOLD), membership)


def _agreement(views: Views, candidate: _Candidate, searched: set[str]) -> float:
    """Return the detector's mean score over the searched photos that face the candidate, times the candidate's fit.

    A photo in which the detector found something else counts 0: a candidate that several photos agree on wins over one
    with a higher score in a single photo.
    """
    facing = [
        camera.photo
        for camera in views.facing(np.median(views.scene.gaussians.means[candidate.membership >= THRESHOLD], axis=0))
        if camera.photo in searched
    ]
    best_by_photo: dict[str, float] = {}
    for item in candidate.evidence:
        photo = item.view.camera.photo
        best_by_photo[photo] = max(best_by_photo.get(photo, 0.0), item.score)
    return min(1.0, sum(best_by_photo.values()) / max(len(facing), len(best_by_photo)) * candidate.fit)


def mean_direction(
    features: Float32, *, start: Float32 | None = None, cosine: float = 0.7
) -> Float32 | None:  # published: Dahaghin et al. 2024
    """Return the mean direction of features without outliers.

    Parameters
    ----------
    features : array of shape [P, D], float32
        Features of a mask's pixels, at unit length.
    start : array of shape [D], float32, optional
        Unit vector to start from, e.g. the feature of the clicked pixel; by default the mean of the features.
    cosine : float
        In each of three rounds, features with a smaller cosine to the current direction are left out of the mean.

    Returns
    -------
    array of shape [D], float32, or None
        A unit vector; None without features or if they cancel out.
    """
    if len(features) == 0:
        return None
    direction = normalized(features.mean(axis=0)) if start is None else start
    for _ in range(_N_DIRECTION_ROUNDS):
        near = features @ direction >= cosine
        if not near.any():
            break
        direction = normalized(features[near].mean(axis=0))
    return direction if np.abs(direction).sum() > 0 else None


def calibrated(cosine: NDArray[np.floating], threshold: float) -> Float32:
    """Map cosines to memberships, piecewise linearly: -1 to 0, `threshold` to exactly 0.5 and 1 to 1."""
    cosine = np.asarray(cosine, np.float32)
    above = 0.5 + 0.5 * (cosine - np.float32(threshold)) / np.float32(1 - threshold)
    below = 0.5 * (cosine + 1) / np.float32(1 + threshold)
    # Rounding must not bring a cosine below the threshold to 0.5.
    below = np.minimum(below, BELOW_HALF)
    return np.clip(np.where(cosine >= np.float32(threshold), above, below), 0, 1).astype(np.float32)


def within_quartiles(points: Float32, factor: float) -> Mask:
    """Return which points are within `factor` interquartile ranges of the quartiles on every axis, bool [M]."""
    if len(points) == 0:
        return np.zeros(0, bool)
    first, third = np.percentile(points, [25, 75], axis=0)
    reach = factor * (third - first)
    return np.asarray(((points >= first - reach) & (points <= third + reach)).all(axis=1))


def inside_hull(corners: Float32, points: Float32) -> Mask:
    """Return which points are inside the convex hull of `corners`.

    Parameters
    ----------
    corners : array of shape [M, 3], float32
    points : array of shape [N, 3], float32

    Returns
    -------
    bool array of shape [N]
        All False if the hull has no volume (fewer than four corners, or all on one plane).
    """
    inside = np.zeros(len(points), bool)
    if len(corners) < 4:
        return inside
    try:
        hull = ConvexHull(corners.astype(np.float64))
    except QhullError:
        log.info("The %d Gaussians found are on one plane and have no convex hull to fill.", len(corners))
        return inside
    near = np.flatnonzero(((points >= corners.min(axis=0)) & (points <= corners.max(axis=0))).all(axis=1))
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    # In pieces to bound memory: a hull may have thousands of faces and a scene a million Gaussians.
    for piece in np.array_split(near, max(1, len(near) // 4096)):
        inside[piece] = (points[piece].astype(np.float64) @ normals.T + offsets <= 0).all(axis=1)
    return inside
