"""Adam in float32 compared with Adam in float64 over 10,000 steps."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import torch

from ...core.arrays import Float64
from ...core.errors import NumericalError
from ...training import AdamState, adam_step
from .bounds import Bounds
from .measure import Finding

Gradient = Callable[[Float64, int], Float64]

STEPS = 10_000
"""Number of optimiser steps."""
_N_PARAMETERS = 64
_NOISE: Float64 = (
    (np.geomspace(1e-12, 1e6, _N_PARAMETERS) * (0.3 + np.random.default_rng(0).normal(size=(256, _N_PARAMETERS))))
    .astype(np.float32)
    .astype(np.float64)
)


def same_gradients(parameter: Float64, step: int) -> Float64:
    """Return a constant gradient with noise, of sizes 1e-12 to 1e6: float32 values, the same for both precisions."""
    return _NOISE[step % len(_NOISE)]


def valley(parameter: Float64, step: int) -> Float64:
    """Return the gradient of sum_k c_k (p_k - 1)^2 / 2 with c from 1e-6 to 1e6, at the given parameters."""
    return np.geomspace(1e-6, 1e6, len(parameter)) * (parameter - 1.0)


def drifts(gradient: Gradient, rate: float) -> Callable[[Bounds], Finding]:
    """Return a case that measures the largest difference of a parameter after `STEPS` steps at learning rate `rate`.

    The difference is relative to the largest value that the parameter had. Parameters start at 0.5 to 1.5.
    """

    def run(bounds: Bounds) -> Finding:
        start = np.linspace(0.5, 1.5, _N_PARAMETERS).astype(np.float32)
        ours = torch.tensor(start)
        state = AdamState.zeros_like(ours)
        exact, mean, square = start.astype(np.float64), np.zeros(_N_PARAMETERS), np.zeros(_N_PARAMETERS)
        largest = np.abs(exact)
        for step in range(1, STEPS + 1):
            current = ours.numpy().astype(np.float64)
            adam_step(
                [(ours, torch.tensor(gradient(current, step).astype(np.float32)), rate)],
                [state],
                largest=math.inf,
                threads=1,
            )
            g = gradient(exact, step)
            # Kingma & Ba 2015, algorithm 1, with the defaults of `adam_step`
            mean = 0.9 * mean + 0.1 * g
            square = 0.999 * square + 0.001 * g * g
            corrected = np.sqrt(square / (1.0 - 0.999**step)) + 1e-15
            exact = exact - rate * (mean / (1.0 - 0.9**step)) / corrected
            largest = np.maximum(largest, np.abs(exact))
        drift = float((np.abs(ours.numpy() - exact) / largest).max())
        problems = [] if drift <= bounds.forward else [f"after {STEPS} steps a parameter is wrong by {drift:.1e}"]
        return Finding("bounded", forward=drift, problems=tuple(problems))

    return run


def refuses_gradient(bounds: Bounds) -> Finding:
    """Check that Adam refuses a gradient that is not finite and leaves the parameters unchanged."""
    problems = []
    for bad in (np.nan, np.inf, -np.inf):
        parameter, gradient = torch.ones(5, 3), torch.ones(5, 3)
        gradient[2, 1] = bad
        state = AdamState.zeros_like(parameter)
        try:
            adam_step([(parameter, gradient, 0.1)], [state], threads=1)
            problems.append(f"{bad} is not refused")
        except NumericalError:
            if not bool((parameter == 1.0).all()) or state.step:
                problems.append(f"{bad} is refused only after parameters were changed")
    return Finding("refused", problems=tuple(problems))
