"""Errors of training steps on a card, as the processor's steps raise them."""

from __future__ import annotations

from typing import NoReturn

import numpy as np
import torch

from ...core.errors import NumericalError
from ...rasterizer import check_finite
from .parameters import GpuParameters

_TOO_MANY_PAIRS, _ALL_LEFT_OUT = 16, 32  # as in optimiser.wgsl


def is_refusal(found: int) -> bool:
    """Return whether a step was not made because of its gradient alone, as in verdict.wgsl."""
    return found not in (0, _TOO_MANY_PAIRS) and not found & 5


def raise_fault(found: int, parameters: GpuParameters) -> NoReturn:
    """Raise NumericalError for the reason `found` in the status that a step was not made."""
    if found & 1:
        for name, value in parameters.values().items():
            check_finite(name, torch.from_numpy(value))
            if name == "log_scales":
                with np.errstate(over="ignore"):
                    check_finite("scales", torch.from_numpy(np.exp(value)))
        raise NumericalError("a parameter of the Gaussians is not finite; resume from the last checkpoint.")
    if found & 4:
        raise NumericalError(
            "the rendered image is not finite at a pixel that is compared with the photo; "
            "lower the learning rate or resume from the last checkpoint."
        )
    if found & 2:
        raise NumericalError("the gradient of the image is not finite; check the loss that produced it.")
    if found == _ALL_LEFT_OUT:
        raise NumericalError(
            "no gradient of any Gaussian is finite; lower the learning rate or resume from the last checkpoint."
        )
    raise NumericalError(
        "a gradient of the Gaussians is not finite; lower the learning rate or resume from the last checkpoint."
    )
