"""What a training step on a card is asked to do, and the photos that it reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...scene import PinholeCamera
from ..losses import Sample
from .training_frame import Dropout, PositionNoise


@dataclass(frozen=True)
class StepPlan:
    """One training step.

    Attributes
    ----------
    photo : int
        Result of `GpuTrainer.add_photo`.
    learning_rates : mapping of str to float
        By the names of `GROUPS`. Groups that are left out, and ``sh_rest`` at degree 0, keep values and moments.
        The processor's trainer leaves out ``features`` in steps without a loss of features.
    sh_degree : int
        Highest band of spherical harmonics.
    exposure_rate : float, optional
        Learning rate of the exposures, which otherwise keep values and moments.
    centred : sequence of int
        Views whose mean exposure is subtracted after the step.
    lambda_opacity : float
        Weight of the mean opacity.
    lambda_ray : float
        Weight of the disagreement of features along rays; needs `StepSettings.unit_features`.
    terms : sequence of Sample
        What losses with kernels of their own are evaluated on, at most one of each class. A `PaperSample` needs a read
        from the card.
    dropout : Dropout, optional
    noise : PositionNoise, optional
        Random walk after the step, before the limits.
    limits : bool
        Whether `StepSettings.limits` are applied after the step.
    """

    photo: int
    learning_rates: Mapping[str, float]
    sh_degree: int
    exposure_rate: float | None = None
    centred: Sequence[int] = ()
    lambda_opacity: float = 0.0
    lambda_ray: float = 0.0
    terms: Sequence[Sample] = ()
    dropout: Dropout | None = None
    noise: PositionNoise | None = None
    limits: bool = True

    def sort(self) -> None:
        """Sort the samples now, and not when the step is queued: another thread can do that ahead."""
        for sample in self.terms:
            sample.sort()


@dataclass(frozen=True)
class Photo:
    """A photo on the card; see `PhotoLoss` and `camera_values`."""

    camera: PinholeCamera
    camera_values: NDArray[np.uint32]
    pixels: Any
    n_valid: int
    by_features: Any
    view: int


def valid_pixels(shape: tuple[int, ...], valid: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
    """Return the pixels that count; raise ValueError where `valid` does not fit, or leaves none."""
    counts = np.ones(shape, bool) if valid is None else np.asarray(valid, bool)
    if counts.shape != shape or not counts.any():
        raise ValueError(f"`valid` must have shape {shape} and leave a pixel for the loss")
    return counts
