"""The published method: one feature for the mask of a prompt, all Gaussians near it, then their convex hull.

Dahaghin et al., "Gaussian Heritage" (2024). docs/paper.md lists where text, released code and this module differ.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ..core.arrays import Float32, Floats, Mask, normalized
from ..core.errors import PromptError
from ..masks import mask_box
from .context import SegmentationContext
from .evidence import (
    clicks_by_photo,
    connected_members,
    evidence_of_exclusions,
    find_evidence,
    pixel_of,
    places_in,
    require_known,
    require_mask,
)
from .found import BELOW_THRESHOLD, NONE_BEHIND, NONE_LEFT, FoundObject, Levels, fit_of, is_same, nothing_found
from .graph import bounded
from .prompts import ClickPrompt, Place, Prompt, TextPrompt
from .settings import MEMBER_THRESHOLD, PaperSettings
from .views import View, erode_mask, spread_cameras
from .votes import MaskEvidence, count_votes

_LOG = logging.getLogger(__name__)

_LIKE_THE_CLICK = 0.5
"""Share of a mask's pixels that must be like the clicked one for its feature to be the first direction: a single pixel
may lie on a seam."""

_LEAST_PIXELS = 0.5
"""Pixels of an excluded mask that a Gaussian contributes, from which on it is removed."""


def find_objects_of_paper(context: SegmentationContext, prompt: Prompt, settings: PaperSettings) -> list[FoundObject]:
    """Return the objects that `prompt` asks for, the best first; the errors are those of `find_objects`."""
    if isinstance(prompt, TextPrompt):
        evidence = _from_text(prompt.text, context.part(0, 2))
    elif isinstance(prompt, ClickPrompt):
        evidence = evidence_of_exclusions(prompt.clicks, prompt.excluded, context)
        for view, places in clicks_by_photo(prompt.clicks, context):
            outside = places_in(view.camera.photo, prompt.excluded)
            evidence.append(_from_clicks(view, places, outside, context, settings.cosine))
    else:
        evidence = find_evidence(prompt, context)
    shown = [item for item in evidence if not item.excluded]
    removed = _shown_by([item for item in evidence if item.excluded], context)
    candidates = _candidates(shown, prompt, context, settings)
    if not candidates:
        raise PromptError(NONE_BEHIND)
    if isinstance(prompt, TextPrompt):
        searched = {item.view.camera.photo for item in shown}
        candidates = [replace(one, score=_agreement(one, searched, context)) for one in candidates]
        candidates.sort(key=lambda one: -one.score)
    found: list[FoundObject] = []
    for number, candidate in enumerate(candidates, start=1):
        if len(found) == settings.max_objects or candidate.score < settings.relative_score * candidates[0].score:
            break
        membership = _completed(candidate, context.means, settings)
        membership = np.where(removed, np.minimum(membership, BELOW_THRESHOLD), membership)
        one = replace(candidate, levels=Levels((membership,)))
        if one.members.any() and not any(is_same(one.members, o.members) for o in found):
            found.append(one)
        context.part(1, 2).tell(number / len(candidates), "Isolating")
    if not found:
        raise PromptError(NONE_LEFT)
    return found


def _candidates(
    evidence: Sequence[MaskEvidence], prompt: Prompt, context: SegmentationContext, settings: PaperSettings
) -> list[FoundObject]:
    """Lift each mask to the Gaussians and merge what shows the same ones, led by the mask with the best fit."""
    candidates: list[FoundObject] = []
    for item in sorted(evidence, key=lambda item: -item.score):
        context.check_stop()
        membership = _lift(item, prompt, context, settings)
        if membership is None:
            continue
        one = FoundObject(
            Levels((membership,)), item.score, fit_of(item, membership >= MEMBER_THRESHOLD, context.views), (item,)
        )
        alike = (k for k, other in enumerate(candidates) if is_same(other.members, one.members))
        same = next(alike, None)
        if same is None:
            candidates.append(one)
        else:
            better, other = sorted((candidates[same], one), key=lambda each: -each.score * each.fit)
            candidates[same] = replace(better, evidence=better.evidence + other.evidence)
    return candidates


def _from_text(text: str, context: SegmentationContext) -> list[MaskEvidence]:
    """Return the masks of a text in several photos, of segments where there are some; raises `PromptError` for none."""
    require_known(text, context)
    evidence = []
    # Existing segments are better regions than any box, and cost nothing.
    views, photos, label_maps = context.views, context.photos, context.label_maps
    segmented = [camera for camera in views.cameras.cameras if camera.photo in label_maps]
    cameras = spread_cameras(segmented or views.cameras.cameras, context.settings.n_text_views)
    for number, camera in enumerate(cameras, start=1):
        context.check_stop()
        view, labels = views.of(camera), label_maps.get(camera.photo)
        for found in context.detector.detect(photos.pixels(camera), text, labels=labels):
            if labels is None:
                x0, y0, x1, y1 = (float(side) / photos.scale(camera) for side in found.box)
                mask = view.from_photo(photos.segment(camera, box=(x0, y0, x1, y1))[0])
            else:
                mask = view.from_photo(labels == found.region)
            if mask.any():
                evidence.append(MaskEvidence(view, mask, found.score))
        context.tell(number / len(cameras), f"Looking for {text!r} ({context.detector.name})")
    if not evidence:
        raise PromptError(nothing_found(text, context))
    return evidence


def _from_clicks(
    view: View, places: Sequence[Place], outside: Sequence[Place], context: SegmentationContext, cosine: float
) -> MaskEvidence:
    """Return SAM's mask of the clicks, or of the box around what has features like theirs: that with the higher score.

    With excluded clicks in the photo it is always the first, which alone leaves them `outside`.
    """
    mask, score = context.photos.segment(view.camera, points=places, outside=outside)
    box = None if outside else _box_of_similar(view, places, cosine)
    if box is not None:
        boxed, score_of_box = context.photos.segment(view.camera, box=box)
        mask, score = (boxed, score_of_box) if score_of_box >= score else (mask, score)
    return require_mask(MaskEvidence(view, view.from_photo(mask), score))


def _box_of_similar(view: View, places: Sequence[Place], cosine: float) -> tuple[int, int, int, int] | None:
    """Return the box, in the photo, around the connected area with features like those of the clicked pixels.

    None where no Gaussian covers a clicked pixel.
    """
    pixels = np.array([pixel_of(view, x, y) for x, y in places])
    columns, rows = pixels[view.covered[pixels[:, 1], pixels[:, 0]]].T
    if len(rows) == 0:
        return None
    similar = ((view.features @ view.features[rows, columns].T).max(axis=-1) >= cosine) & view.covered
    areas = cv2.connectedComponents(similar.astype(np.uint8))[1]
    return mask_box(view.to_photo(np.isin(areas, areas[rows, columns])))


def _lift(item: MaskEvidence, prompt: Prompt, context: SegmentationContext, settings: PaperSettings) -> Float32 | None:
    """Return the Gaussians with features like the mask's that are connected to what it shows; None without any."""
    view, mask, views = item.view, item.mask, context.views
    inner = erode_mask(mask, settings.erode_pixels) & view.covered
    if not inner.any():
        inner = mask & view.covered
    features, start = view.features[inner], None
    places = places_in(view.camera.photo, prompt.clicks) if isinstance(prompt, ClickPrompt) else []
    if len(places) == 1 and len(features):
        column, row = pixel_of(view, *places[0])
        clicked = view.features[row, column]
        start = clicked if (features @ clicked >= settings.cosine).mean() >= _LIKE_THE_CLICK else None
    direction = mean_direction(features, start=start, cosine=settings.cosine)
    if direction is None:
        return None
    membership = calibrated(views.directions @ direction, settings.cosine)
    connected = connected_members(membership >= MEMBER_THRESHOLD, item, views)
    membership = np.where(connected, membership, np.minimum(membership, BELOW_THRESHOLD))
    return bounded(membership, context.means) if connected.any() else None


def _shown_by(evidence: Sequence[MaskEvidence], context: SegmentationContext) -> Mask:
    """Return the Gaussians that lie behind any of the masks more than beside it, bool [N]."""
    shown = np.zeros(len(context.means), bool)
    for item in evidence:
        votes = count_votes(context.views, item, shown.astype(np.float32))
        shown |= (votes.inside >= _LEAST_PIXELS) & (votes.inside > votes.outside)
    return shown


def _completed(candidate: FoundObject, means: Float32, settings: PaperSettings) -> Float32:
    """Return the membership with the convex hull of the object filled in at `MEMBER_THRESHOLD`."""
    corners, membership = means[candidate.members], candidate.membership
    if settings.outlier_iqr is not None:
        corners = corners[within_quartiles(corners, settings.outlier_iqr)]
    return np.where(inside_hull(corners, means), np.maximum(membership, MEMBER_THRESHOLD), membership)


def _agreement(candidate: FoundObject, searched: set[str], context: SegmentationContext) -> float:
    """Return the detector's mean score over the searched photos that face the candidate, times the candidate's fit.

    A photo in which the detector found something else counts 0: a candidate that several photos agree on wins over one
    with a higher score in a single photo.
    """
    middle = np.median(context.means[candidate.members], axis=0)
    facing = [camera.photo for camera in context.views.facing(middle) if camera.photo in searched]
    best_by_photo: dict[str, float] = {}
    for item in candidate.evidence:
        photo = item.view.camera.photo
        best_by_photo[photo] = max(best_by_photo.get(photo, 0.0), item.score)
    return min(1.0, sum(best_by_photo.values()) / max(len(facing), len(best_by_photo)) * candidate.fit)


def mean_direction(features: Float32, cosine: float, start: Float32 | None = None) -> Float32 | None:
    """Return the mean direction of features without outliers.

    Features with a cosine below `cosine` to the direction so far are left out, until these stay the same.

    Parameters
    ----------
    features : array of shape [P, D], float32
        Of a mask's pixels, at unit length.
    cosine : float
        -1 to 1.
    start : array of shape [D], float32, or None
        First direction, e.g. the feature of the clicked pixel; None takes the mean of all.

    Returns
    -------
    array of shape [D], float32, or None
        None if there are no features or they cancel out.
    """
    if len(features) == 0:
        return None
    direction = normalized(features.mean(axis=0)) if start is None else start
    kept = np.zeros(len(features), bool)
    for _ in features:
        near = features @ direction >= cosine
        if not near.any() or (near == kept).all():
            break
        kept, direction = near, normalized(features[near].mean(axis=0))
    return direction if np.abs(direction).sum() > 0 else None


def calibrated(cosine: Floats, threshold: float) -> Float32:
    """Map cosines to memberships, piecewise linearly: -1 to 0, `threshold` to `MEMBER_THRESHOLD` exactly, 1 to 1."""
    cosine = np.asarray(cosine, np.float32)
    above = MEMBER_THRESHOLD + (1 - MEMBER_THRESHOLD) * (cosine - np.float32(threshold)) / np.float32(1 - threshold)
    # Rounding must not bring a cosine below the threshold to the members.
    below = np.minimum(MEMBER_THRESHOLD * (cosine + 1) / np.float32(1 + threshold), BELOW_THRESHOLD)
    return np.clip(np.where(cosine >= np.float32(threshold), above, below), 0, 1).astype(np.float32)


def within_quartiles(points: Float32, factor: float) -> Mask:
    """Return which points are within some interquartile ranges of the quartiles on every axis.

    Parameters
    ----------
    points : array of shape [M, 3], float32
    factor : float
        Number of interquartile ranges.

    Returns
    -------
    array of shape [M], bool
    """
    if len(points) == 0:
        return np.zeros(0, bool)
    first, third = np.quantile(points, (1 / 4, 3 / 4), axis=0)
    reach = factor * (third - first)
    return np.asarray(((points >= first - reach) & (points <= third + reach)).all(axis=1))


def inside_hull(corners: Float32, points: Float32) -> Mask:
    """Return which points are inside of a convex hull.

    Parameters
    ----------
    corners : array of shape [M, 3], float32
        Points whose hull it is.
    points : array of shape [N, 3], float32

    Returns
    -------
    array of shape [N], bool
        All False if the hull has no volume: fewer than four corners, or all on one plane.
    """
    inside = np.zeros(len(points), bool)
    try:
        hull = ConvexHull(corners.astype(np.float64))
    except (QhullError, ValueError):
        _LOG.info("The %d Gaussians found are on one plane and have no convex hull to fill.", len(corners))
        return inside
    near = np.flatnonzero(((points >= corners.min(axis=0)) & (points <= corners.max(axis=0))).all(axis=1))
    for face in hull.equations:
        near = near[points[near].astype(np.float64) @ face[:-1] + face[-1] <= 0]
    inside[near] = True
    return inside
