"""Detection of transients, such as people who walk by: pixels whose error no other photo of the same place has."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch

from ..core.arrays import Float32, Mask
from ..rasterizer.settings import Backend
from .parameters import Parameters, render
from .views import Level

MIN_ERROR_RATIO = 3.0  # chosen on museum_room
"""Smallest ratio of the error of a transient's pixel to its expected error."""

MIN_ERROR = 0.12  # chosen on museum_room
"""Smallest mean colour difference of a transient's pixel, values in [0, 1]. Smaller ones can be shadows."""

MIN_REGION_FRACTION = 0.008  # chosen on museum_room
"""Smallest fraction of a picture that is left out as one region. Smaller regions are mostly things that other photos
show too, with errors. See docs/design_notes/training.md."""

MAX_MASKED_FRACTION = 0.5  # chosen on museum_room
"""Largest fraction of a picture that is left out. Beyond it the pose or exposure of the photo is wrong, which leaving
out pixels does not repair."""

MARGIN_FRACTION = 0.015  # chosen on museum_room
"""Width of the margin around a transient, for its soft edge, as a fraction of the longest side."""

MIN_PIXELS_ELSEWHERE = 1.0  # chosen on museum_room
"""Number of pixels of other photos that a Gaussian must cover so that its expected error is known."""


def find_transients(
    parameters: Parameters, levels: Sequence[Level], *, backend: Backend, sh_degree: int
) -> list[Mask | None]:
    """Return for each photo the mask of pixels that show something that no other photo shows, None for no such pixels.

    Parameters
    ----------
    parameters : Parameters
        Trained for a few rounds, so that they already show what the photos have in common.
    levels : sequence of Level
        The training photos, at one small size.
    backend : {"cpu", "reference"}
        Which rasterizer is used.

    Notes
    -----
    Each Gaussian g has a mean error in each photo i over its pixels, a_gi / w_gi, where w is the sum of the blending
    weights and a the sum of the weights times the error. Both are gradients of a picture with two additional channels.
    The expected error of the Gaussian in photo i is its mean error in all other photos. Blending it gives the expected
    error of each pixel, and a pixel is a transient where its error is three times as large. Difficult places such as
    reflections and leaves have a large error in all photos and are kept.
    """
    values = {name: value.detach() for name, value in parameters.values.items()}
    errors, sums = [], []
    for level in levels:
        error, error_and_weight = _error_of_each(values, level, backend, sh_degree)
        errors.append(error)
        sums.append(error_and_weight)
    total = torch.stack(sums).sum(dim=0)
    typical = float(np.median(np.concatenate([error.ravel() for error in errors])))
    masks = []
    for level, error, own in zip(levels, errors, sums, strict=True):
        others = total - own
        seen = others[:, 1] > MIN_PIXELS_ELSEWHERE
        # Gaussians that no other photo sees may have any error.
        expected = torch.where(seen, others[:, 0] / others[:, 1].clamp_min(1e-6), torch.ones(()))
        with torch.no_grad():
            raster = render(
                values, level.camera, backend=backend, sh_degree=None, channels=expected[:, None].contiguous()
            )
        blend = (raster.image[..., 0] / (1.0 - raster.transmittance).clamp_min(0.05)).numpy()
        masks.append(_transient_mask(error, blend, typical, level))
    return masks


def _error_of_each(
    values: dict[str, torch.Tensor], level: Level, backend: Backend, sh_degree: int
) -> tuple[Float32, torch.Tensor]:
    """Return the error of each pixel [h, w], and for each Gaussian its error and weight summed over pixels [N, 2]."""
    channels = torch.zeros(len(values["means"]), 2, requires_grad=True)
    raster = render(values, level.camera, backend=backend, sh_degree=sh_degree, channels=channels)
    photo = torch.from_numpy(level.pixels).float().div_(255.0)
    difference = (raster.image[..., :3].detach() - photo).abs().mean(dim=2).numpy()
    error = np.asarray(cv2.blur(difference, (3, 3)), np.float32)
    weights = np.ones(error.shape, np.float32) if level.valid is None else level.valid.astype(np.float32)
    upstream = torch.from_numpy(np.stack([error * weights, weights], axis=-1))
    (raster.image[..., 3:] * upstream).sum().backward()  # type: ignore[no-untyped-call]
    assert channels.grad is not None
    return error, channels.grad


def _transient_mask(error: Float32, expected: Float32, typical: float, level: Level) -> Mask | None:
    mask = (error > MIN_ERROR) & (error > MIN_ERROR_RATIO * np.maximum(expected, typical))
    if level.valid is not None:
        mask &= level.valid
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    closed = cv2.morphologyEx(opened, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    _, regions, statistics, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    large = statistics[:, cv2.CC_STAT_AREA] >= MIN_REGION_FRACTION * error.size
    large[0] = False
    kept = large[regions]
    if not kept.any():
        return None
    margin = max(1, round(MARGIN_FRACTION * max(error.shape)))
    mask = np.asarray(cv2.dilate(kept.astype(np.uint8), np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)) > 0)
    return None if mask.mean() > MAX_MASKED_FRACTION else mask
