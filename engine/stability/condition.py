"""Condition numbers: how much a float64 result moves, per relative rounding of what it is computed from."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import torch

__all__ = ["DRAWS", "STEP", "perturbed", "row_norms", "sensitivities"]

Arrays = Mapping[str, torch.Tensor]

STEP = 2.0**-36
"""Relative size of the perturbations: small enough that no order by depth (rounded to float32) and no pixel away from a
threshold changes, large enough that float64's own rounding stays 1e-5 of what is measured."""

DRAWS = 4
"""Perturbations tried. The largest movement counts; with four, missing half of it has a chance of about 1 in 50."""


def row_norms(values: torch.Tensor) -> torch.Tensor:
    """Return the Euclidean norm of every row of `values` [N, ...]: normwise per Gaussian, shape [N]."""
    return values.reshape(len(values), -1).norm(dim=1) if len(values) else values.new_zeros(0)


def perturbed(values: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
    """Return `values` with every number times 1 + STEP or 1 - STEP, by the toss of a coin."""
    signs = torch.randint(0, 2, values.shape, generator=generator).to(values.dtype) * 2.0 - 1.0
    return values * (1.0 + STEP * signs)


def sensitivities(compute: Callable[[Arrays], Arrays], inputs: Arrays, *, seed: int = 11) -> dict[str, torch.Tensor]:
    """Return for every array that `compute` gives, and each of its rows, the absolute movement per relative change.

    With y = compute(x) in float64 and random signs s (Rademacher) for every number in x::

        sensitivity_i = max over draws of |y_i(x (1 + STEP s)) - y_i(x)| / STEP
        condition_i   = sensitivity_i / |y_i|

    |.| is the Euclidean norm of a row. One rounding of the inputs to float32 moves y_i by about EPS32 / 2 times that,
    which no float32 program can avoid, and a backward stable one (the exact result of inputs that are a few roundings
    away) exceeds by a modest factor only.

    Parameters
    ----------
    compute : callable
        From named float64 arrays to named float64 arrays [N, ...]. It must not use the ``cpu`` backend.
    inputs : mapping of str to tensor
        All that is rounded: the Gaussians' arrays, and for gradients also the incoming gradient of the picture.
    seed : int
        Of the signs.

    References
    ----------
    Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed. 2002, sections 1.5 and 1.6. Kenney & Laub,
    Small-sample statistical condition estimates for general matrix functions, SIAM J. Sci. Comput. 15 (1994).
    """
    generator = torch.Generator().manual_seed(seed)
    base = compute(inputs)
    moved = {name: torch.zeros(len(value), dtype=torch.float64) for name, value in base.items()}
    for _ in range(DRAWS):
        found = compute({name: perturbed(value, generator) for name, value in inputs.items()})
        for name, value in found.items():
            moved[name] = torch.maximum(moved[name], row_norms(value - base[name]) / STEP)
    return moved
