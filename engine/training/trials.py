"""Trials of what a scene may not need: some steps with it and without it, from one state, on the same photos."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from .held_out import Quality, image_quality, mean_quality
from .views import Level

MAX_BRIGHTNESS_FACTOR = 4.0  # chosen on museum_room
"""Largest brightness factor that is fitted, and inverse of the smallest. A black picture shows no exposure."""


@dataclass(frozen=True)
class Trial:
    """Result of a trial.

    Attributes
    ----------
    what : str
        The number of a band of view-dependent colour.
    step : int
        Number of finished steps when the trial began.
    n_steps : int
        Number of steps with, and without, what was tried.
    gain : float
        PSNR on the validation photos in dB, with minus without.
    kept : bool
        Whether the run goes on with what was tried.
    """

    what: str
    step: int
    n_steps: int
    gain: float
    kept: bool


def brightness_factors(image: torch.Tensor, level: Level) -> torch.Tensor:
    """Return the factors of the colours, shape [3], that fit `image` to the photo, by least squares.

    They are clamped to `MAX_BRIGHTNESS_FACTOR` and its inverse.
    """
    target = torch.from_numpy(level.pixels).float().div_(255.0)
    valid = torch.ones(target.shape[:2], dtype=torch.bool) if level.valid is None else torch.from_numpy(level.valid)
    rendered, expected = image[valid].double(), target[valid].double()
    factors = (rendered * expected).sum(dim=0) / rendered.square().sum(dim=0).clamp_min(1e-9)
    return factors.clamp(1.0 / MAX_BRIGHTNESS_FACTOR, MAX_BRIGHTNESS_FACTOR).float()


def exposure_corrected_quality(picture: Callable[[Level], torch.Tensor], levels: Sequence[Level]) -> Quality:
    """Return the mean quality over `levels` of pictures whose brightness is fitted to their photos.

    `picture` renders one as `held_out.render_picture` does. The exposure of a photo that was not trained on is unknown,
    so errors that brightness factors can correct are not counted, neither with the correction nor without.
    """
    qualities = []
    for level in levels:
        image = picture(level)
        qualities.append(image_quality(image * brightness_factors(image, level), level.pixels, level.valid))
    return mean_quality(qualities)
