"""What stands in one photo only: people who walk by. Found by its error, which no other photo of the same place has."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from .parameters import Parameters, render
from .settings import TrainingSettings
from .views import Level

__all__ = ["find_transients"]

Mask = NDArray[np.bool_]
Float32 = NDArray[np.float32]

_TIMES_EXPECTED = 3.0
_LEAST_ERROR = 0.12
"""Mean difference of a colour, values in [0, 1]: less is no other thing but shade."""
_SMALLEST_PART = 0.008
_LARGEST_PART = 0.5
"""Of a picture. Smaller parts are mostly things that other photos show too, badly: with people pasted into 15 of 42
photos of a room, parts from 0.008 on found 96 % of their pixels and 0.2 % others, from 0.001 on 98 % and 1.3 %. Of
parts larger than the largest, the photo's place or exposure is wrong, which leaving out pixels does not repair."""
_MARGIN = 0.015
"""Of the longest side: the soft edge of what is found."""
_SEEN_ELSEWHERE = 1.0
"""Pixels of other photos that a Gaussian must cover for their error to say what is to be expected."""


def find_transients(
    parameters: Parameters, levels: Sequence[Level], settings: TrainingSettings, *, sh_degree: int
) -> list[Mask | None]:
    """Return for each photo which pixels show what the other photos do not, None where there are none.

    Parameters
    ----------
    parameters : Parameters
        Trained for a few rounds: what all photos agree on must be there already.
    levels : sequence of Level
        The photos trained on, at one small size.
    settings : TrainingSettings
    sh_degree : int

    Notes
    -----
    Each Gaussian g has a mean error in each photo i, over its pixels: a_gi / w_gi with w the blending weights summed
    and a those times the error, both gradients of a picture with two more channels. What is to be expected of it in
    photo i is its mean error in all others. Blended, that is the expected error of each pixel; a pixel is out of place
    where its error is three times that. Hard places (reflections, leaves) are hard in all photos and stay in.
    """
    values = {name: value.detach() for name, value in parameters.values.items()}
    errors, sums = [], []
    for level in levels:
        error, found = _error_of_each(values, level, settings, sh_degree)
        errors.append(error)
        sums.append(found)
    total = torch.stack(sums).sum(dim=0)
    typical = float(np.median(np.concatenate([error.ravel() for error in errors])))
    masks = []
    for level, error, own in zip(levels, errors, sums, strict=True):
        others = total - own
        seen = others[:, 1] > _SEEN_ELSEWHERE
        # What no other photo sees may look however it does.
        expected = torch.where(seen, others[:, 0] / others[:, 1].clamp_min(1e-6), torch.ones(()))
        with torch.no_grad():
            raster = render(values, level.camera, settings, sh_degree=None, extra=expected[:, None].contiguous())
        blend = (raster.image[..., 0] / (1.0 - raster.transmittance).clamp_min(0.05)).numpy()
        masks.append(_out_of_place(error, blend, typical, level))
    return masks


def _error_of_each(
    values: dict[str, torch.Tensor], level: Level, settings: TrainingSettings, sh_degree: int
) -> tuple[Float32, torch.Tensor]:
    """Return the picture's error [h, w] and, for each Gaussian, its error and its weight summed over pixels [N, 2]."""
    votes = torch.zeros(len(values["means"]), 2, requires_grad=True)
    raster = render(values, level.camera, settings, sh_degree=sh_degree, extra=votes)
    photo = torch.from_numpy(level.pixels).float().div_(255.0)
    difference = (raster.image[..., :3].detach() - photo).abs().mean(dim=2).numpy()
    error = np.asarray(cv2.blur(difference, (3, 3)), np.float32)
    counts = np.ones(error.shape, np.float32) if level.valid is None else level.valid.astype(np.float32)
    upstream = torch.from_numpy(np.stack([error * counts, counts], axis=-1))
    (raster.image[..., 3:] * upstream).sum().backward()  # type: ignore[no-untyped-call]
    assert votes.grad is not None
    return error, votes.grad


def _out_of_place(error: Float32, expected: Float32, typical: float, level: Level) -> Mask | None:
    found = (error > _LEAST_ERROR) & (error > _TIMES_EXPECTED * np.maximum(expected, typical))
    if level.valid is not None:
        found &= level.valid
    opened = cv2.morphologyEx(found.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    closed = cv2.morphologyEx(opened, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    _, parts, figures, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    large = figures[:, cv2.CC_STAT_AREA] >= _SMALLEST_PART * error.size
    large[0] = False
    kept = large[parts]
    if not kept.any():
        return None
    margin = max(1, round(_MARGIN * max(error.shape)))
    mask = np.asarray(cv2.dilate(kept.astype(np.uint8), np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)) > 0)
    return None if mask.mean() > _LARGEST_PART else mask
