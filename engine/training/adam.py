"""The Adam optimiser on the CPU, in place. The result does not depend on the number of threads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numba import njit

from ..core.arrays import Float32
from ..core.errors import NumericalError
from ..rasterizer import JIT, Share, all_finite, new_counters, run_shared, take_range

BETAS, EPS = (0.9, 0.999), 1e-15
"""Decay of the running means of the gradient and of its square, and what is added to the denominator."""

LARGEST_STEP = 1.0  # chosen on banana16, museum_room, room_3, room_6, room_8
"""Largest change of a value in one step, in its learning rate. Late in a run, Adam moves a value whose moments were
zero or faded by three to six times its rate: that of a fresh Gaussian, or of one that few photos show."""

MAX_REFUSED_STEPS = 20
"""Training steps without an update, because a gradient is not finite, after which training fails."""

_VALUES_PER_RANGE = 4096
"""Number of neighbouring values that a thread processes before it takes the next ones."""


@dataclass
class AdamState:
    """Running moments of one parameter. Rows may be set to zero or copied when Gaussians are moved.

    Attributes
    ----------
    mean, square : tensors with the parameter's shape, contiguous
        Moving averages of the gradient and of its square.
    step : int
        Number of completed steps.
    """

    mean: torch.Tensor
    square: torch.Tensor
    step: int = 0

    @classmethod
    def zeros_like(cls, parameter: torch.Tensor) -> AdamState:
        """Return the state before the first step."""
        zeros = torch.zeros_like(parameter, requires_grad=False, memory_format=torch.contiguous_format)
        return cls(zeros, zeros.clone())

    def copy(self) -> AdamState:
        """Return an independent copy."""
        return AdamState(self.mean.clone(), self.square.clone(), self.step)


@njit(**JIT)
def _adam(
    share: Share,
    parameter: Float32,
    gradient: Float32,
    mean: Float32,
    square: Float32,
    beta1: np.float32,
    beta2: np.float32,
    one_minus_beta1: np.float32,
    one_minus_beta2: np.float32,
    step_size: np.float32,
    root_correction: np.float32,
    eps: np.float32,
    largest: np.float32,
) -> None:
    """Update one parameter in place.

    m = b1 m + (1 - b1) g;  v = b2 v + (1 - b2) g^2;  p -= step_size m / (sqrt(v) root_correction + eps), which is
    clamped to +-largest.
    """
    n = gradient.shape[0]
    first, last = take_range(share, n, _VALUES_PER_RANGE)
    while first < last:
        for i in range(first, last):
            g = gradient[i]
            m = beta1 * mean[i] + one_minus_beta1 * g
            v = beta2 * square[i] + one_minus_beta2 * g * g
            mean[i] = m
            square[i] = v
            change = step_size * m / (np.sqrt(v) * root_correction + eps)
            parameter[i] -= min(largest, max(-largest, change))
        first, last = take_range(share, n, _VALUES_PER_RANGE)


def adam_step(
    groups: Sequence[tuple[torch.Tensor, torch.Tensor, float]],
    states: Sequence[AdamState],
    *,
    largest: float = LARGEST_STEP,
    threads: int | None = None,
) -> None:
    """Do one step of Adam, as `torch.optim.Adam` does it, on several parameters, with limited changes.

    Parameters
    ----------
    groups : sequence of (parameter, gradient, learning rate)
        Parameters are contiguous float32 tensors on the CPU and are changed in place. A learning rate of 0 updates the
        moments only.
    states : sequence of AdamState
        One for each parameter, changed in place.
    largest : float
        Largest change of a value, in its learning rate; infinite for the steps of torch.
    threads : int, optional
        All usable cores by default.

    Raises
    ------
    NumericalError
        If a gradient is not finite. Nothing has been changed then.
    ValueError
        If a parameter or state is not contiguous float32, or their shapes differ.

    References
    ----------
    Kingma & Ba 2015, "Adam: A Method for Stochastic Optimization", Algorithm 1.
    """
    gradients = [gradient.detach().contiguous().numpy().reshape(-1) for _, gradient, _ in groups]
    for index, gradient in enumerate(gradients):
        if not all_finite(gradient):
            n_bad = int((~np.isfinite(gradient)).sum())
            raise NumericalError(
                f"the gradient of parameter {index} (shape {tuple(groups[index][0].shape)}) is not finite in {n_bad} "
                "values; lower the learning rate or resume from the last checkpoint."
            )
    beta1, beta2 = BETAS
    calls = []
    for (parameter, _, rate), gradient, state in zip(groups, gradients, states, strict=True):
        for tensor in (parameter, state.mean, state.square):
            if not tensor.is_contiguous() or tensor.dtype != torch.float32 or tensor.shape != parameter.shape:
                raise ValueError("Adam takes contiguous float32 parameters and states of one shape")
        state.step += 1
        step_size = rate / (1.0 - beta1**state.step)
        root_correction = 1.0 / math.sqrt(1.0 - beta2**state.step)
        arrays = [tensor.detach().numpy().reshape(-1) for tensor in (parameter, state.mean, state.square)]
        factors = (
            beta1,
            beta2,
            1.0 - beta1,
            1.0 - beta2,
            step_size,
            root_correction,
            EPS,
            largest * rate if rate else 0.0,
        )
        calls.append((new_counters(threads), arrays, gradient, [np.float32(factor) for factor in factors]))

    def work(share: Share) -> None:
        for counters, (parameter, mean, square), gradient, factors in calls:
            _adam(Share(counters, share.thread), parameter, gradient, mean, square, *factors)

    run_shared(work, threads)
