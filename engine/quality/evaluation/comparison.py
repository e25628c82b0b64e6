"""Comparison of isolated Gaussians with true masks in photos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ...core.arrays import Float64, Mask
from ...core.errors import Cancelled, MaskError
from ...core.events import StopCheck
from ...masks import boundary_iou, halo, holes, iou, stray
from ...photos import load_pixels
from ...pictures import Scene, render_view, visible_masks
from ...scene import Camera
from .ground_truth import GroundTruth
from .image_metrics import psnr

_MAX_ASPECT_DEVIATION = 0.02
"""Largest relative difference of the aspect ratios of a photo and its mask."""


class Scores(NamedTuple):
    """Scores of one view, or their means over the views."""

    iou: float
    boundary_iou: float
    halo: float
    stray: float
    holes: float
    psnr: float


NOTHING_RETURNED = Scores(0.0, 0.0, np.nan, np.nan, 1.0, np.nan)


@dataclass(frozen=True)
class Comparison:
    """Comparison of K sets of Gaussians with each of M objects.

    Attributes
    ----------
    iou, boundary_iou : arrays of shape [K, M], float64
        Means over the compared photos that show the object; NaN for an object that none of them shows. `boundary_iou`
        is NaN for pairs that were not wanted.
    n_shown, n_ignored : arrays of shape [K], int64
        Pixels of the set in all compared photos, and those of them that show ignored things.
    """

    iou: Float64
    boundary_iou: Float64
    n_shown: NDArray[np.int64]
    n_ignored: NDArray[np.int64]


def score_photo(
    scene: Scene, camera: Camera, photo: Path, members: Sequence[Mask | None], masks: Sequence[Mask]
) -> list[Scores]:
    """Return the scores of sets of Gaussians in one photo, each against a true mask.

    Parameters
    ----------
    camera : Camera
        Of the photo.
    photo : Path
        The photo, for the PSNR.
    members : sequence of bool arrays of shape [N], or None
        None where nothing was returned.
    masks : sequence of bool arrays of shape [h, w]
        True mask for each of `members`, at any resolution.

    Raises
    ------
    MaskError
        When a mask has another aspect ratio than the photo.
    PhotoError
        When the photo cannot be read.
    """
    shown = visible_masks(scene, camera, [each for each in members if each is not None])
    pixels = load_pixels(photo) if any(each is not None for each in members) else None
    scores = []
    for each, mask in zip(members, masks, strict=True):
        if each is None:
            scores.append(NOTHING_RETURNED)
            continue
        assert pixels is not None
        inside = resized(mask, (camera.height, camera.width), camera.photo)
        predicted = resized(next(shown), mask.shape, camera.photo)
        alone = render_view(scene.gaussians, camera, what="rgb", members=each)
        scores.append(
            Scores(
                iou(predicted, mask),
                boundary_iou(predicted, mask),
                halo(predicted, mask),
                stray(predicted, mask),
                holes(predicted, mask),
                psnr(alone, pixels, mask=inside) if inside.any() else np.nan,
            )
        )
    return scores


def compare_with_all(
    scene: Scene,
    cameras: Mapping[str, Camera],
    members: Sequence[Mask],
    truth: GroundTruth,
    photos: Sequence[str],
    *,
    with_boundary: Mask | None = None,
    should_stop: StopCheck,
) -> Comparison:
    """Compare sets of Gaussians with every object of the ground truth.

    Parameters
    ----------
    cameras : mapping of str to Camera
        By photo.
    members : sequence of K bool arrays of shape [N]
    truth : GroundTruth
        With M objects.
    photos : sequence of str
        Photos to compare in.
    with_boundary : bool array of shape [K, M], optional
        Pairs whose boundary IoU is wanted; none by default.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    MaskError
        When a mask cannot be read, or has another aspect ratio than its photo.
    """
    shape = (len(members), len(truth.objects))
    wanted = np.zeros(shape, bool) if with_boundary is None else with_boundary
    sums, boundary_sums, counts = np.zeros(shape), np.zeros(shape), np.zeros(shape[1])
    n_shown, n_ignored = np.zeros(len(members), np.int64), np.zeros(len(members), np.int64)
    for photo in photos if members else ():
        if should_stop():
            raise Cancelled("Stopped while comparing; nothing was written.")
        camera = cameras[photo]
        masks = {truth.objects.index(name): mask for name, mask in truth.masks(photo).items()}
        ignored = np.zeros((camera.height, camera.width), bool)
        for mask in truth.ignored_masks(photo).values():
            ignored |= resized(mask, ignored.shape, photo)
        counts[list(masks)] += 1
        for k, shown in enumerate(visible_masks(scene, camera, members)):
            n_shown[k] += np.count_nonzero(shown)
            n_ignored[k] += np.count_nonzero(shown & ignored)
            for m, mask in masks.items():
                predicted = resized(shown, mask.shape, photo)
                sums[k, m] += iou(predicted, mask)
                boundary_sums[k, m] += boundary_iou(predicted, mask) if wanted[k, m] else 0.0
    counts[counts == 0] = np.nan
    return Comparison(sums / counts, np.where(wanted, boundary_sums / counts, np.nan), n_shown, n_ignored)


def resized(mask: Mask, shape: tuple[int, ...], photo: str) -> Mask:
    """Return a mask of the whole photo at another resolution.

    Raises
    ------
    MaskError
        When its aspect ratio differs, so that it cannot belong to this photo.
    """
    if mask.shape == shape:
        return mask
    (height, width), (new_height, new_width) = mask.shape, shape
    if abs(width / height * new_height / new_width - 1) > _MAX_ASPECT_DEVIATION:
        raise MaskError(
            f"The true masks of {photo} have another aspect ratio: {width} x {height} pixels and "
            f"{new_width} x {new_height}."
        )
    return np.asarray(cv2.resize(mask.astype(np.uint8), (new_width, new_height), interpolation=cv2.INTER_NEAREST) > 0)
