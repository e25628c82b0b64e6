"""The true object of every Gaussian, from the true masks of all photos."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...cameras import covering_pinhole, undistort
from ...core.errors import Cancelled
from ...core.events import StopCheck
from ...masks import mask_iou
from ...pictures import Scene
from ...scene import CameraSet
from .ground_truth import GroundTruth

UNSEEN = -1
"""Label of Gaussians that no photo shows."""
_MIN_WEIGHT = 1.0
"""Smallest sum of blending weights of a Gaussian over all photos, in pixels. Below it, its object is unknown."""
_MAX_SIDE = 800
"""Longest side of the renders that count, pixels."""


def gaussian_truth(scene: Scene, cameras: CameraSet, truth: GroundTruth, should_stop: StopCheck) -> NDArray[np.int32]:
    """Return for each Gaussian the index into ``truth.objects`` that most of its pixels show.

    Parameters
    ----------
    truth : GroundTruth
        With `every_pixel`.

    Returns
    -------
    array of shape [N], int32
        ``len(truth.objects)`` for Gaussians in no mask, `UNSEEN` for those that make up less than a pixel of all photos
        together. Pixels count with the blending weight alpha * transmittance.

    Raises
    ------
    Cancelled
        When `should_stop` says so.
    MaskError
        When a mask cannot be read.
    """
    if not truth.every_pixel:
        raise ValueError("these masks do not label every pixel")
    n_objects = len(truth.objects)
    votes = np.zeros((len(scene), n_objects + 1), np.float32)
    for camera in cameras.cameras:
        if camera.photo not in truth.readers:
            continue
        if should_stop():
            raise Cancelled("Stopped while counting the true masks; nothing was written.")
        frame = covering_pinhole(camera, max_side=_MAX_SIDE)
        weights = np.zeros((frame.height, frame.width, n_objects + 1), np.float32)
        for name, mask in truth.masks(camera.photo).items():
            taken = undistort(mask.astype(np.uint8), camera, frame, interpolation="nearest")
            weights[..., truth.objects.index(name)] = taken
        within = np.ones((max(1, camera.height // 4), max(1, camera.width // 4)), np.uint8)
        photo = undistort(within, camera, frame, interpolation="nearest") > 0
        weights[..., n_objects] = photo & (weights[..., :n_objects].max(axis=-1, initial=0.0) == 0)
        votes += scene.votes(frame, weights)
    return np.where(votes.sum(axis=1) < _MIN_WEIGHT, UNSEEN, votes.argmax(axis=1)).astype(np.int32)


def gaussian_iou(members: NDArray[np.bool_] | None, labels: NDArray[np.int32], index: int) -> float:
    """Return the IoU of `members`, bool [N], with the Gaussians labelled `index`, among those that photos show.

    0 for None, which means that nothing was found, and where both sets are empty.
    """
    if members is None:
        return 0.0
    return mask_iou(members & (labels != UNSEEN), labels == index)
