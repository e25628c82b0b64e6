"""Picture metrics against their definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.core.errors import NumericalError
from engine.quality.evaluation.image_metrics import psnr


def pictures(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    smooth = np.cumsum(rng.normal(size=(40, 50, 3)), axis=1)
    image = (smooth - smooth.min()) / np.ptp(smooth)
    return image, np.clip(image + rng.normal(0, 0.05, image.shape), 0, 1)


def test_equal_pictures_are_perfect() -> None:
    image, _ = pictures()
    assert psnr(image, image) == math.inf


def test_a_known_difference_gives_the_known_figures() -> None:
    black, grey = np.zeros((16, 16, 3), np.uint8), np.full((16, 16, 3), 51, np.uint8)
    assert psnr(black, grey) == pytest.approx(-20 * math.log10(0.2))


def test_8_bit_and_float_pictures_agree() -> None:
    image, other = ((picture * 255).round().astype(np.uint8) for picture in pictures())
    assert psnr(image, other) == pytest.approx(psnr(image / 255, other / 255), rel=1e-6)


def test_only_pixels_of_the_mask_count() -> None:
    image, other = pictures()
    mask = np.zeros(image.shape[:2], bool)
    mask[:10, :10] = True
    spoiled = np.where(mask[..., None], other, 1.0)
    assert psnr(image, other, mask=mask) == psnr(image, spoiled, mask=mask)
    with pytest.raises(ValueError, match="no pixel"):
        psnr(image, other, mask=np.zeros_like(mask))


def test_pictures_that_cannot_be_compared_are_refused() -> None:
    image, other = pictures()
    with pytest.raises(ValueError, match="shape"):
        psnr(image, other[:-1])
    image[3, 3, 0] = np.nan
    with pytest.raises(NumericalError):
        psnr(image, other)
