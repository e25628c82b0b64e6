"""Adam on the CPU, fused over all parameters and in place. Every element is computed alone, so any thread count agrees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray

from ..errors import NumericalError
from .finite import all_finite
from .jit import JIT
from .threads import Share, nothing_taken, run_shared, take

__all__ = ["AdamState", "adam_step"]

Float32 = NDArray[np.float32]

_VALUES_AT_ONCE = 4096
"""Values that one thread takes together."""


@dataclass
class AdamState:
    """Running moments of one parameter; rows may be set to zero or copied when Gaussians are moved.

    Attributes
    ----------
    mean, square : tensors with the parameter's shape, contiguous
        Moving averages of the gradient and of its square.
    step : int
        Steps done.
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
        """Return a state of its own with the same values."""
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
    rest1: np.float32,
    rest2: np.float32,
    step_size: np.float32,
    root_correction: np.float32,
    eps: np.float32,
) -> None:
    """m = b1 m + (1 - b1) g;  v = b2 v + (1 - b2) g^2;  p -= step_size m / (sqrt(v) root_correction + eps)."""
    n = gradient.shape[0]
    first, last = take(share, n, _VALUES_AT_ONCE)
    while first < last:
        for i in range(first, last):
            g = gradient[i]
            m = beta1 * mean[i] + rest1 * g
            v = beta2 * square[i] + rest2 * g * g
            mean[i] = m
            square[i] = v
            parameter[i] -= step_size * m / (np.sqrt(v) * root_correction + eps)
        first, last = take(share, n, _VALUES_AT_ONCE)


def adam_step(
    groups: Sequence[tuple[torch.Tensor, torch.Tensor, float]],
    states: Sequence[AdamState],
    *,
    beta1: float = 0.9,
    beta2: float = 0.999,
    eps: float = 1e-15,
    threads: int | None = None,
) -> None:
    """Do one step of Adam (Kingma & Ba 2015, as in torch.optim.Adam) on each (parameter, gradient, learning rate).

    Parameters and states are changed in place; they must be contiguous float32 on the CPU. A learning rate of 0
    updates the moments only.

    Raises
    ------
    NumericalError
        When a gradient is not finite; nothing has been changed then.
    """
    gradients = [gradient.detach().contiguous().numpy().reshape(-1) for _, gradient, _ in groups]
    for index, gradient in enumerate(gradients):
        if not all_finite(gradient):
            n_bad = int((~np.isfinite(gradient)).sum())
            raise NumericalError(
                f"the gradient of parameter {index} (shape {tuple(groups[index][0].shape)}) is not finite in {n_bad} "
                "values; lower the learning rate or resume from the last checkpoint."
            )
    calls = []
    for (parameter, _, rate), gradient, state in zip(groups, gradients, states, strict=True):
        for tensor in (parameter, state.mean, state.square):
            if not tensor.is_contiguous() or tensor.dtype != torch.float32 or tensor.shape != parameter.shape:
                raise ValueError("Adam takes contiguous float32 parameters and states of one shape")
        state.step += 1
        step_size = rate / (1.0 - beta1**state.step)
        root_correction = 1.0 / math.sqrt(1.0 - beta2**state.step)
        arrays = [tensor.detach().numpy().reshape(-1) for tensor in (parameter, state.mean, state.square)]
        numbers = (beta1, beta2, 1.0 - beta1, 1.0 - beta2, step_size, root_correction, eps)
        calls.append((nothing_taken(threads), arrays, gradient, [np.float32(number) for number in numbers]))

    def work(share: Share) -> None:
        for taken, (parameter, mean, square), gradient, numbers in calls:
            _adam(Share(taken, share.own), parameter, gradient, mean, square, *numbers)

    run_shared(work, threads)
