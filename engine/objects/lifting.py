"""Lifting of masks to Gaussians: by the features of one mask (the paper's method), and by votes of many views."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled
from ..events import StopCheck
from ..masks import mask_iou
from ..pictures import find_clusters
from .selection import (
    HALF,
    RADIUS_PERCENTAGE,
    calibrated,
    connected_parts,
    inside_hull,
    mean_direction,
    with_members,
    within_quartiles,
    without_far,
)
from .settings import SegmentSettings
from .views import View, Views, erode_mask, spread_cameras
from .voting import VoteCount, has_majority_in_mask, votes_of_mask

__all__ = ["Lifted", "complete", "lift", "lift_group", "refine_by_votes", "snap_to_segments"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_MIN_PART_SHARE = 0.03  # chosen on museum_room
"""Smallest part of an object with a direction of its own, as a share of the mask's pixels."""

_MAX_RADII = 2.0  # chosen on museum_room, store_room
"""Distance from the middle of a mask's Gaussians beyond which nothing belongs, in radii."""


@dataclass(frozen=True)
class Lifted:
    """Gaussians that a mask of one view was lifted to.

    Attributes
    ----------
    directions : array of shape [K, D], float32
        Unit vectors in feature space, one for each part of the object.
    membership : array of shape [N], float32
        In [0, 1]; a Gaussian belongs from 0.5 on.
    evidence_weights : array of shape [N], float32
        Pixels of the evidence mask that each Gaussian contributes.
    known : bool
        Whether the members were given instead of found by their features. The first round of votes then uses the
        members instead of the features.
    """

    directions: Float32
    membership: Float32
    evidence_weights: Float32
    known: bool = False

    @property
    def members(self) -> Mask:
        """Gaussians that belong, bool [N]."""
        return self.membership >= HALF


def lift(
    views: Views,
    view: View,
    mask: Mask,
    settings: SegmentSettings,
    *,
    start: Float32 | None = None,
    given: bool = False,
) -> Lifted | None:
    """Return the Gaussians with features similar to the mask's that are connected to what it shows.

    Parameters
    ----------
    views : Views
    view : View
        View of the mask.
    mask : bool array of shape [h, w]
        In the frame of `view`.
    settings : SegmentSettings
    start : array of shape [D], optional
        Unit vector to start the mean direction from, e.g. the feature of the clicked pixel.
    given : bool
        Whether the user drew the mask. What it leaves out then does not belong (see `_excluded_by_mask`).

    Returns
    -------
    Lifted or None
        Before completion. None if no Gaussian covers the mask or none has a similar feature.
    """
    inner = erode_mask(mask, settings.erode_pixels) & view.covered
    if not inner.any():
        inner = mask & view.covered
    directions = _directions(view, mask, inner, settings, start)
    if directions is None:
        return None
    membership = calibrated((views.directions @ directions.T).max(axis=1), settings.cosine)
    votes = votes_of_mask(views, view, mask)
    if given and settings.keep_given:
        membership[_excluded_by_mask(views, votes)] = 0.0
    evidence_weights = votes[:, 0]
    membership = _only_connected(views, membership, evidence_weights)
    if not (membership >= HALF).any():
        return None
    return Lifted(directions, membership, evidence_weights)


def lift_group(views: Views, view: View, mask: Mask, members: Mask, settings: SegmentSettings) -> Lifted | None:
    """Return a known group of Gaussians as if it had been lifted from the mask that shows it.

    Parameters
    ----------
    views : Views
    view : View
    mask : bool array of shape [h, w]
        Pixels of `view` that show the members.
    members : bool array of shape [N]
    settings : SegmentSettings

    Returns
    -------
    Lifted or None
        None if no Gaussian covers the mask.
    """
    inner = mask & view.covered
    directions = _directions(view, mask, inner, settings, None) if inner.any() else None
    if directions is None:
        return None
    similarity = calibrated((views.directions @ directions.T).max(axis=1), settings.cosine)
    membership = without_far(views.scene.gaussians.means, with_members(similarity, members), members)
    evidence_weights = votes_of_mask(views, view, mask)[:, 0]
    return Lifted(directions, membership, evidence_weights, known=True)


def _directions(
    view: View, mask: Mask, inner: Mask, settings: SegmentSettings, start: Float32 | None
) -> Float32 | None:
    """Return the directions of `mask` in feature space, [K, D]: the mean first, then those of further parts."""
    mean = mean_direction(view.features[inner], start=start, cosine=settings.cosine)
    if mean is None:
        return None
    directions = [mean]
    features = view.features[inner]
    for center in find_clusters(features, np.ones(len(features)), cosine=settings.cosine):
        if len(directions) == settings.parts:
            break
        known = max(float(center @ direction) for direction in directions) >= settings.cosine
        if not known and (features @ center >= settings.cosine).mean() >= _MIN_PART_SHARE:
            similar = view.like(center[None], settings.cosine)
            if _purity(similar, mask) >= settings.part_purity:
                directions.append(center)
    return np.stack(directions)


def _purity(similar: Mask, mask: Mask) -> float:
    """Return the share of `similar` that is in `mask`, among its connected areas that touch `mask`."""
    areas = cv2.connectedComponents(similar.astype(np.uint8))[1]
    touching = np.isin(areas, np.unique(areas[mask & similar])) & similar
    return float((touching & mask).sum() / max(1, touching.sum()))


def _only_connected(views: Views, membership: Float32, evidence_weights: Float32) -> Float32:
    """Return the membership with 0 for Gaussians that are far from the part that the evidence mask shows."""
    means = views.scene.gaussians.means
    members = np.flatnonzero(membership >= HALF)
    kept = members[connected_parts(means[members], evidence_weights[members])]
    if len(kept) == 0:
        return np.zeros_like(membership)
    belongs = np.zeros(len(membership), bool)
    belongs[kept] = True
    return without_far(means, membership, belongs)


def complete(views: Views, lifted: Lifted, settings: SegmentSettings) -> Float32:
    """Return the membership with the object's convex hull filled in at 0.5 if the settings ask for it.

    Parameters
    ----------
    views : Views
    lifted : Lifted
    settings : SegmentSettings
        `completion` and `outlier_iqr`.

    Returns
    -------
    array of shape [N], float32
    """
    if settings.completion == "none":
        return lifted.membership
    means = views.scene.gaussians.means
    corners = means[lifted.members]
    if settings.outlier_iqr is not None:
        corners = corners[within_quartiles(corners, settings.outlier_iqr)]
    return np.where(inside_hull(corners, means), np.maximum(lifted.membership, HALF), lifted.membership)


def refine_by_votes(
    views: Views,
    lifted: Lifted,
    given: tuple[View, Mask] | None,
    label_maps: Mapping[str, NDArray[np.int32]],
    settings: SegmentSettings,
    *,
    should_stop: StopCheck,
) -> Lifted:
    """Refine a membership by votes of masks in many views.

    In the first round, the mask of a view contains the pixels near the object whose rendered feature is similar to the
    object's: blending averages out the noise of single Gaussians. It also contains the pixels that show the Gaussians
    in the user's mask (`keep_given`), because a part of an object may have the feature of its support. In further
    rounds it contains the pixels of which the current members contribute more than half. The mask is then snapped to
    the photo's SAM segments if there are any, and loses what the user's mask excludes. The new membership of a Gaussian
    is the share of its pixels that is in the masks.

    Parameters
    ----------
    views : Views
    lifted : Lifted
        Result of one view.
    given : (View, bool array of shape [h, w]) or None
        A mask drawn by the user. It is used unchanged.
    label_maps : mapping of str to int32 array
        SAM label maps by photo name, in the photo's frame at any resolution.
    settings : SegmentSettings
    should_stop : callable

    Returns
    -------
    Lifted

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """
    prior = lifted.membership
    included = excluded = None
    if given is not None and settings.keep_given:
        votes = votes_of_mask(views, *given)
        included, excluded = has_majority_in_mask(votes), _excluded_by_mask(views, votes)
    for number in range(settings.vote_rounds):
        center = np.median(views.scene.gaussians.means[lifted.members], axis=0)
        count = VoteCount(views)
        for camera in spread_cameras(views.facing(center), settings.n_vote_views):
            if should_stop():
                raise Cancelled("Stopped while viewing the object from all sides; no object was stored.")
            view = views.of(camera)
            if given is not None and given[0].camera.photo == camera.photo:
                mask = given[1]
            else:
                mask = _mask_in(
                    views, view, lifted, cosine=settings.cosine if number == 0 and not lifted.known else None
                )
                if included is not None and number == 0:
                    mask = mask | (views.visible_share(view, included) > 0.5)
                if camera.photo in label_maps:
                    mask = snap_to_segments(mask, view.labels_from_photo(label_maps[camera.photo]))
                if excluded is not None:
                    mask = mask & ~(views.visible_share(view, excluded) > 0.5)
            count.add(view, (mask & view.within)[..., None])
        membership = count.membership(prior[:, None])[:, 0]
        membership = _only_connected(views, membership, count.inside[:, 0])
        if not (membership >= HALF).any():
            break
        lifted = Lifted(lifted.directions, membership, lifted.evidence_weights)
    return lifted


def _excluded_by_mask(views: Views, votes: Float32) -> Mask:
    """Return the Gaussians that a mask drawn by the user excludes, bool [N].

    These are the Gaussians that the view shows outside of the mask rather than in it, and those too far from the middle
    of the Gaussians in the mask: a wall may have the feature of the ball in front of it where SAM drew one segment over
    both.

    Parameters
    ----------
    views : Views
    votes : array of shape [N, 2], float32
        As returned by `votes_of_mask`.
    """
    excluded = np.asarray((votes[:, 1] >= HALF) & (votes[:, 1] >= votes[:, 0]))
    core = has_majority_in_mask(votes)
    if core.any():
        means = views.scene.gaussians.means
        distances = np.linalg.norm(means - np.median(means[core], axis=0), axis=1)
        excluded |= distances > _MAX_RADII * np.percentile(distances[core], RADIUS_PERCENTAGE)
    return excluded


def _mask_in(views: Views, view: View, lifted: Lifted, *, cosine: float | None) -> Mask:
    """Return the pixels of `view` that show the object, [h, w]: by feature with a `cosine`, by members without."""
    if cosine is None:
        return views.visible_share(view, lifted.members) > 0.5
    # `lift` set Gaussians far from the object to 0: similar features may occur elsewhere in the scene.
    nearby = views.visible_share(view, lifted.membership > 0) > 0.5
    return view.like(lifted.directions, cosine) & nearby


def snap_to_segments(mask: Mask, labels: NDArray[np.int32]) -> Mask:
    """Return `mask` with the outlines of the segments that it covers by more than half.

    Pixels without a segment stay as they are. If the IoU of the result with the mask is below 0.5, the segments do not
    match the object, and the mask is returned unchanged.
    """
    count = np.bincount(labels.ravel())
    covered = np.bincount(labels.ravel(), weights=mask.ravel(), minlength=len(count))
    filled = covered > 0.5 * count
    snapped = np.where(labels > 0, filled[labels], mask)
    if mask_iou(snapped, mask) < 0.5:
        return mask
    return np.asarray(snapped)
