"""Condition numbers: relative change of a float64 result per relative change of its inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch

Arrays = Mapping[str, torch.Tensor]

_SEED = 11
"""Seed of the random signs."""

STEP = 2.0**-36
"""Relative size of the perturbations. It is so small that neither the order by depth (rounded to float32) nor a pixel
away from a threshold changes, and so large that the rounding of float64 is 1e-5 of the measured change."""

DRAWS = 4
"""Number of random perturbations, of which the largest change counts. With four, it is less than half of the true one
with a probability of about 1 in 50."""


def row_norms(values: torch.Tensor) -> torch.Tensor:
    """Return the Euclidean norm of every row of `values` [N, ...], shape [N]."""
    return values.reshape(len(values), -1).norm(dim=1) if len(values) else values.new_zeros(0)


def perturbed(values: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
    """Return `values` with every number multiplied by 1 + STEP or 1 - STEP, chosen at random."""
    signs = torch.randint(0, 2, values.shape, generator=generator).to(values.dtype) * 2.0 - 1.0
    return values * (1.0 + STEP * signs)


def sensitivities(compute: Callable[[Arrays], Arrays], inputs: Arrays) -> dict[str, torch.Tensor]:
    """Return the absolute change per relative change of the inputs, for each row of the arrays that `compute` returns.

    With y = compute(x) in float64 and random signs s (Rademacher) for every number in x::

        sensitivity_i = max over draws of |y_i(x (1 + STEP s)) - y_i(x)| / STEP
        condition_i   = sensitivity_i / |y_i|

    |.| is the Euclidean norm of a row. Rounding the inputs to float32 changes y_i by about EPS32 / 2 times the
    sensitivity, which no float32 program can avoid. The error of a backward stable program (one whose result is exact
    for inputs that are a few roundings away) exceeds this by a small factor only.

    Parameters
    ----------
    compute : callable
        Function from named float64 arrays to named float64 arrays [N, ...]. It must not use the ``cpu`` backend.
    inputs : mapping of str to tensor
        All arrays that are rounded: those of the Gaussians and, for gradients, the incoming gradient of the picture.

    References
    ----------
    Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed. 2002, sections 1.5 and 1.6. Kenney & Laub,
    Small-sample statistical condition estimates for general matrix functions, SIAM J. Sci. Comput. 15 (1994).
    """
    generator = torch.Generator().manual_seed(_SEED)
    base = compute(inputs)
    largest = {name: torch.zeros(len(value), dtype=torch.float64) for name, value in base.items()}
    for _ in range(DRAWS):
        changed = compute({name: perturbed(value, generator) for name, value in inputs.items()})
        for name, value in changed.items():
            largest[name] = torch.maximum(largest[name], row_norms(value - base[name]) / STEP)
    return largest
