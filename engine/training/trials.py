"""What a scene may not need is tried: some steps with it and without, from one state, on the same photos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from .held_out import Quality, image_quality, mean_quality, render_picture
from .settings import TrainingSettings
from .views import Level

__all__ = ["EXPOSURE", "Trial", "brightness_factors", "quality_but_for_brightness"]

EXPOSURE = "exposure"
"""Name of the trial of brightness factors; those of bands are their numbers."""


@dataclass(frozen=True)
class Trial:
    """How one ended.

    Attributes
    ----------
    what : str
        "exposure", or the number of a band of view-dependent colour.
    step : int
        Finished steps when it began.
    n_steps : int
        Steps that were done with and without.
    gain : float
        dB of PSNR on the held-out photos, with over without.
    kept : bool
        Whether what was tried is used from then on.
    """

    what: str
    step: int
    n_steps: int
    gain: float
    kept: bool


def brightness_factors(image: torch.Tensor, level: Level) -> torch.Tensor:
    """Return the factors of the colours, shape [3], that bring `image` nearest to the photo, by least squares.

    Between 1/4 and 4: a picture that is still black says nothing of the photo's exposure.
    """
    target = torch.from_numpy(level.pixels).float().div_(255.0)
    counted = torch.ones(target.shape[:2], dtype=torch.bool) if level.valid is None else torch.from_numpy(level.valid)
    drawn, wanted = image[counted].double(), target[counted].double()
    factors = (drawn * wanted).sum(dim=0) / drawn.square().sum(dim=0).clamp_min(1e-9)
    return factors.clamp(0.25, 4.0).float()


def quality_but_for_brightness(
    values: dict[str, torch.Tensor], levels: Sequence[Level], settings: TrainingSettings, *, sh_degree: int
) -> Quality:
    """Return the mean quality over `levels` of pictures that are as bright as their photos.

    Nobody knows the exposure of a photo that was not trained on: what its factors could mend is not counted, with the
    correction or without.
    """
    found = []
    for level in levels:
        image = render_picture(values, level, settings, sh_degree=sh_degree)
        found.append(image_quality(image * brightness_factors(image, level), level.pixels, level.valid))
    return mean_quality(found)
