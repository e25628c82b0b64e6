"""The peak signal-to-noise ratio of 8-bit or float pictures."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import NumericalError


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
