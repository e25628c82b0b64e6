"""Which object every Gaussian truly belongs to, by the true masks of all photos."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..cameras import covering_pinhole, undistort
from ..errors import Cancelled
from ..events import StopCheck
from ..pictures import Scene
from ..scene import CameraSet
from .ground_truth import GroundTruth

__all__ = ["UNSEEN", "gaussian_iou", "gaussian_truth"]

UNSEEN = -1
_LEAST_SEEN = 1.0
"""Pixels, over all photos, that a Gaussian must make up: nothing is known of one that no photo shows."""

_SIDE = 800


def gaussian_truth(scene: Scene, cameras: CameraSet, truth: GroundTruth, should_stop: StopCheck) -> NDArray[np.int32]:
    """Return the index into ``truth.objects`` that most of each Gaussian's pixels truly show.

    Parameters
    ----------
    scene : Scene
    cameras : CameraSet
    truth : GroundTruth
        With `every_pixel`.
    should_stop : callable

    Returns
    -------
    array of shape [N], int32
        ``len(truth.objects)`` for what is in no mask, `UNSEEN` for Gaussians that make up less than a pixel of all
        photos together. Pixels count with the blending weight alpha * transmittance.

    Raises
    ------
    Cancelled
        When `should_stop` says so.
    MaskError
        When a mask cannot be read.
    """
    if not truth.every_pixel:
        raise ValueError("these masks do not say of every pixel what it shows")
    n_objects = len(truth.objects)
    votes = np.zeros((len(scene), n_objects + 1), np.float32)
    for camera in cameras.cameras:
        if camera.photo not in truth.readers:
            continue
        if should_stop():
            raise Cancelled("Stopped while the true masks were counted; nothing was written.")
        frame = covering_pinhole(camera, max_side=_SIDE)
        weights = np.zeros((frame.height, frame.width, n_objects + 1), np.float32)
        for name, mask in truth.masks(camera.photo).items():
            taken = undistort(mask.astype(np.uint8), camera, frame, interpolation="nearest")
            weights[..., truth.objects.index(name)] = taken
        within = np.ones((max(1, camera.height // 4), max(1, camera.width // 4)), np.uint8)
        photo = undistort(within, camera, frame, interpolation="nearest") > 0
        weights[..., n_objects] = photo & (weights[..., :n_objects].max(axis=-1, initial=0.0) == 0)
        votes += scene.votes(frame, weights)
    return np.where(votes.sum(axis=1) < _LEAST_SEEN, UNSEEN, votes.argmax(axis=1)).astype(np.int32)


def gaussian_iou(members: NDArray[np.bool_] | None, labels: NDArray[np.int32], index: int) -> float:
    """Return the IoU of members, bool [N], with the Gaussians labelled `index`, among those that are seen.

    0 for None, which stands for nothing found, and where both are empty.
    """
    if members is None:
        return 0.0
    members, true = members & (labels != UNSEEN), labels == index
    union = int((members | true).sum())
    return int((members & true).sum()) / union if union else 0.0
