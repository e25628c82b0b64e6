"""From a mask in one view to a membership for every Gaussian: the paper's way, and votes of many views."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled
from ..events import StopCheck
from ..pictures import find_clusters
from .selection import calibrated, connected_parts, inside_hull, mean_direction, with_members, within_quartiles
from .settings import SegmentSettings
from .views import View, Views, eroded, spread_cameras

__all__ = ["Lifted", "behind", "complete", "lift", "lift_group", "refine_by_votes", "snap_to_segments", "votes_of_mask"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_HALF = np.float32(0.5)
_SMALLEST_PART = 0.03
_MOST_RADII = 2.0
"""The radius holds 90 % of what lies behind the mask."""
_JUST_BELOW = np.nextafter(_HALF, np.float32(0))


@dataclass(frozen=True)
class Lifted:
    """A mask of one view, lifted to the Gaussians.

    Attributes
    ----------
    directions : array of shape [K, D], float32
        The prompt in feature space, unit vectors; one for each part of the object.
    membership : array of shape [N], float32
        In [0, 1]; 0.5 and above belongs.
    seed_mass : array of shape [N], float32
        Pixels of the seed mask that each Gaussian makes up.
    known : bool
        The members are known, and not found by their features: where votes begin, the members show what belongs.
    """

    directions: Float32
    membership: Float32
    seed_mass: Float32
    known: bool = False

    @property
    def members(self) -> Mask:
        """Gaussians that belong, bool [N]."""
        return self.membership >= _HALF


def lift(
    views: Views,
    view: View,
    mask: Mask,
    settings: SegmentSettings,
    *,
    start: Float32 | None = None,
    given: bool = False,
) -> Lifted | None:
    """Return the Gaussians whose feature is like the mask's and that hang together with what it shows.

    Parameters
    ----------
    views : Views
    view : View
        Where the mask was drawn.
    mask : bool array of shape [h, w]
        In the frame of `view`.
    settings : SegmentSettings
    start : array of shape [D], optional
        Unit vector to begin the mean with, e.g. the feature of the clicked pixel.
    given : bool
        Whether the person drew the mask: then what it leaves out does not belong (see `_denied`).

    Returns
    -------
    Lifted or None
        None when no Gaussian covers the mask, or none is like it. Not completed yet.
    """
    inner = eroded(mask, settings.erode_pixels) & view.covered
    if not inner.any():
        inner = mask & view.covered
    directions = _directions(view, mask, inner, settings, start)
    if directions is None:
        return None
    membership = calibrated((views.directions @ directions.T).max(axis=1), settings.cosine)
    votes = votes_of_mask(views, view, mask)
    if given and settings.keep_given:
        membership[_denied(views, votes)] = 0.0
    seed_mass = votes[:, 0]
    membership = _only_connected(views, membership, seed_mass)
    if not (membership >= _HALF).any():
        return None
    return Lifted(directions, membership, seed_mass)


def lift_group(views: Views, view: View, mask: Mask, members: Mask, settings: SegmentSettings) -> Lifted | None:
    """Return a group of Gaussians as what lies behind the mask that shows it.

    Parameters
    ----------
    views : Views
    view : View
    mask : bool array of shape [h, w]
        Where the members are seen in `view`.
    members : bool array of shape [N]
    settings : SegmentSettings

    Returns
    -------
    Lifted or None
        None when the mask covers nothing.
    """
    inner = mask & view.covered
    directions = _directions(view, mask, inner, settings, None) if inner.any() else None
    if directions is None:
        return None
    likeness = calibrated((views.directions @ directions.T).max(axis=1), settings.cosine)
    membership = with_members(likeness, members)
    seed_mass = views.scene.votes(view.frame, mask[..., None].astype(np.float32))[:, 0]
    return Lifted(directions, _nearby(views, membership, members), seed_mass, known=True)


def _directions(
    view: View, mask: Mask, inner: Mask, settings: SegmentSettings, start: Float32 | None
) -> Float32 | None:
    """Return what `mask` points to in feature space, shape [K, D]: its mean first, then its further parts."""
    mean = mean_direction(view.features[inner], start=start, cosine=settings.cosine)
    if mean is None:
        return None
    kept = [mean]
    features = view.features[inner]
    for center in find_clusters(features, np.ones(len(features)), cosine=settings.cosine):
        if len(kept) == settings.parts:
            break
        known = max(float(center @ other) for other in kept) >= settings.cosine
        if not known and (features @ center >= settings.cosine).mean() >= _SMALLEST_PART:
            like = view.like(center[None], settings.cosine)
            if _purity(like, mask) >= settings.part_purity:
                kept.append(center)
    return np.stack(kept)


def _purity(like: Mask, mask: Mask) -> float:
    """Return how much of `like`, of its connected areas that touch `mask`, lies in `mask`."""
    areas = cv2.connectedComponents(like.astype(np.uint8))[1]
    touching = np.isin(areas, np.unique(areas[mask & like])) & like
    return float((touching & mask).sum() / max(1, touching.sum()))


def _only_connected(views: Views, membership: Float32, seed_mass: Float32) -> Float32:
    """Return the membership with 0 for what is far from the part that the seed sees."""
    members = np.flatnonzero(membership >= _HALF)
    kept = members[connected_parts(views.scene.gaussians.means[members], seed_mass[members])]
    if len(kept) == 0:
        return np.zeros_like(membership)
    belongs = np.zeros(len(membership), bool)
    belongs[kept] = True
    return _nearby(views, membership, belongs)


def _nearby(views: Views, membership: Float32, members: Mask) -> Float32:
    """Return the membership of `members` as it is, of what is beside them below one half, and elsewhere 0.

    Beside the object the slider may reach out for what is nearly like it; elsewhere in the scene it must not.
    """
    means = views.scene.gaussians.means
    low, high = means[members].min(axis=0), means[members].max(axis=0)
    margin = 0.25 * (high - low)
    nearby = ((means >= low - margin) & (means <= high + margin)).all(axis=1)
    around = np.where(nearby, np.minimum(membership, _JUST_BELOW), np.float32(0))
    return np.where(members, membership, around).astype(np.float32)


def complete(views: Views, lifted: Lifted, settings: SegmentSettings) -> Float32:
    """Return the membership with what lies inside of the object filled in at 0.5, where the settings say so.

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
    return np.where(inside_hull(corners, means), np.maximum(lifted.membership, _HALF), lifted.membership)


def refine_by_votes(
    views: Views,
    lifted: Lifted,
    seed: tuple[View, Mask] | None,
    label_maps: Mapping[str, NDArray[np.int32]],
    settings: SegmentSettings,
    *,
    should_stop: StopCheck,
) -> Lifted:
    """Let the masks of many views vote on every Gaussian.

    In the first round, a view's mask are the pixels near the object whose rendered feature is like the prompt:
    blending averages out the noise of single Gaussians; and those that show what lies behind a mask the person gave
    (`keep_given`), for a part of an object may have the feature of what it stands on. In further rounds it is where
    the members found so far are more than half of a pixel. Either is snapped to the photo's SAM segments where there
    are some, and loses what a mask the person gave leaves out. A Gaussian's membership becomes the part of its own
    pixels, weighted with its blending weights, that lies in the masks.

    Parameters
    ----------
    views : Views
    lifted : Lifted
        What one view found.
    seed : (View, bool array of shape [h, w]) or None
        A mask the person gave; it stands as it is.
    label_maps : mapping of str to int32 array
        SAM label maps of photos by name, in the photo's frame at any resolution.
    settings : SegmentSettings
    should_stop : callable

    Returns
    -------
    Lifted
        Refined.

    Notes
    -----
    The vote A_in / (A_in + A_out) is the optimum of a binary assignment of Gaussians to masks (FlashSplat, Shen et
    al. 2024). The cosine enters as a prior worth one pixel, which decides for what no view sees.

    Raises
    ------
    Cancelled
        When `should_stop` says so.
    """
    prior = lifted.membership
    given = denied = None
    if seed is not None and settings.keep_given:
        votes = votes_of_mask(views, *seed)
        given, denied = behind(votes), _denied(views, votes)
    for number in range(settings.vote_rounds):
        center = np.median(views.scene.gaussians.means[lifted.members], axis=0)
        voters = spread_cameras(views.facing(center), settings.n_vote_views)
        inside, seen = np.zeros(len(prior), np.float32), np.zeros(len(prior), np.float32)
        for camera in voters:
            if should_stop():
                raise Cancelled("Stopped while looking at the object from all sides; no object was stored.")
            view = views.of(camera)
            if seed is not None and seed[0].camera.photo == camera.photo:
                mask = seed[1]
            else:
                mask = _mask_in(
                    views, view, lifted, cosine=settings.cosine if number == 0 and not lifted.known else None
                )
                if given is not None and number == 0:
                    mask = mask | (views.visible_share(view, given) > 0.5)
                if camera.photo in label_maps:
                    mask = snap_to_segments(mask, view.labels_from_photo(label_maps[camera.photo]))
                if denied is not None:
                    mask = mask & ~(views.visible_share(view, denied) > 0.5)
            inside += views.scene.votes(view.frame, (mask & view.within)[..., None].astype(np.float32))[:, 0]
            seen += views.seen(view)
        membership = ((inside + prior) / (seen + 1.0)).astype(np.float32)
        membership = _only_connected(views, membership, inside)
        if not (membership >= _HALF).any():
            break
        lifted = Lifted(lifted.directions, membership, lifted.seed_mass)
    return lifted


def votes_of_mask(views: Views, view: View, mask: Mask) -> Float32:
    """Return the pixels that each Gaussian makes up in `mask`, and of what is beside it, [N, 2]."""
    return views.scene.votes(view.frame, np.dstack([mask, view.within & ~mask]).astype(np.float32))


def behind(votes: Float32) -> Mask:
    """Return the Gaussians that make up at least half a pixel of a mask, and more of it than of what is beside it.

    `votes` as of `votes_of_mask`.
    """
    return np.asarray((votes[:, 0] >= _HALF) & (votes[:, 0] > votes[:, 1]))


def _denied(views: Views, votes: Float32) -> Mask:
    """Return the Gaussians that a mask the person gave says do not belong, bool [N]; `votes` as of `votes_of_mask`.

    Those are what the view shows beside the mask rather than in it, and what is farther from the middle of what lies
    `behind` it than two of its radii: a wall may have the feature of the ball before it, where SAM drew one segment
    over both.
    """
    denied = np.asarray((votes[:, 1] >= _HALF) & (votes[:, 1] >= votes[:, 0]))
    core = behind(votes)
    if core.any():
        means = views.scene.gaussians.means
        distances = np.linalg.norm(means - np.median(means[core], axis=0), axis=1)
        denied |= distances > _MOST_RADII * np.percentile(distances[core], 90)
    return denied


def _mask_in(views: Views, view: View, lifted: Lifted, *, cosine: float | None) -> Mask:
    """Return where `view` shows the object, bool [h, w]: by its feature with a `cosine`, by its members without."""
    if cosine is None:
        return views.visible_share(view, lifted.members) > 0.5
    # `lift` gave 0 to everything far from the object, which may have a like feature elsewhere in the scene.
    nearby = views.visible_share(view, lifted.membership > 0) > 0.5
    return view.like(lifted.directions, cosine) & nearby


def snap_to_segments(mask: Mask, labels: NDArray[np.int32]) -> Mask:
    """Return `mask` with the outline of the segments it fills: all of those it covers by more than half.

    Pixels without a segment stay as they are. When that changes more than half of the mask, the segments do not
    know the object and the mask is returned unchanged.
    """
    count = np.bincount(labels.ravel())
    covered = np.bincount(labels.ravel(), weights=mask.ravel(), minlength=len(count))
    filled = covered > 0.5 * count
    snapped = np.where(labels > 0, filled[labels], mask)
    union = np.logical_or(snapped, mask).sum()
    if union == 0 or np.logical_and(snapped, mask).sum() < 0.5 * union:
        return mask
    return np.asarray(snapped)
