"""Image metrics: PSNR, SSIM and mean absolute difference of 8-bit or float pictures."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...core.errors import NumericalError
from ...training import ssim as training_ssim

__all__ = ["l1", "psnr", "ssim"]


def psnr(image: NDArray[Any], target: NDArray[Any], *, mask: NDArray[np.bool_] | None = None) -> float:
    """Return the peak signal-to-noise ratio in dB, infinite for equal pictures.

    Parameters
    ----------
    image, target : array of shape [H, W, 3]
        uint8, or float with values in [0, 1]; values outside are clipped.
    mask : bool array of shape [H, W], optional
        Pixels that count, all by default.

    Raises
    ------
    NumericalError
        When a picture is not finite.
    """
    squared = float(np.square(_difference(image, target, mask)).mean())
    return math.inf if squared == 0.0 else -10.0 * math.log10(squared)


def l1(image: NDArray[Any], target: NDArray[Any], *, mask: NDArray[np.bool_] | None = None) -> float:
    """Return the mean absolute difference, in [0, 1]; parameters and errors as in `psnr`."""
    return float(np.abs(_difference(image, target, mask)).mean())


def ssim(image: NDArray[Any], target: NDArray[Any]) -> float:
    """Return the mean structural similarity (Wang et al. 2004) with an 11x11 Gaussian window, zero beyond the border.

    Parameters
    ----------
    image, target : array of shape [H, W, 3]
        uint8, or float with values in [0, 1]; values outside are clipped.

    Raises
    ------
    NumericalError
        When a picture is not finite.
    """
    one, other = (torch.from_numpy(_unit(picture).astype(np.float32)) for picture in (image, target))
    return float(training_ssim(one, other))


def _difference(image: NDArray[Any], target: NDArray[Any], mask: NDArray[np.bool_] | None) -> NDArray[np.float64]:
    if image.shape != target.shape:
        raise ValueError(f"pictures of shape {image.shape} and {target.shape} cannot be compared")
    difference = _unit(image) - _unit(target)
    if mask is None:
        return difference
    if not mask.any():
        raise ValueError("the mask leaves no pixel to compare")
    return difference[mask]


def _unit(picture: NDArray[Any]) -> NDArray[np.float64]:
    """Return the picture with values in [0, 1]."""
    if picture.dtype == np.uint8:
        return picture.astype(np.float64) / 255.0
    if not np.isfinite(picture).all():
        raise NumericalError("A picture to compare has values that are not finite. Render it again.")
    return np.clip(picture.astype(np.float64), 0.0, 1.0)
