"""Whether every value of an array is finite: looked at in each step, so as fast as memory can be read."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .jit import INNER, JIT
from .llvm import LANES
from .simd import any_of, load, splat

__all__ = ["all_finite", "rows_finite"]


@njit(**INNER)
def _between(values: NDArray[np.float32], start: int, stop: int) -> bool:
    """Return whether flat ``values[start:stop]`` are finite."""
    whole = stop - (stop - start) % LANES
    odd = splat(np.float32(0.0))
    for i in range(start, whole, LANES):
        x = load(values, i)
        odd = odd + (x - x)  # inf - inf and NaN are NaN, and stay so
    if any_of(odd != np.float32(0.0)):
        return False
    rest = np.float32(0.0)
    for i in range(whole, stop):
        rest += values[i] - values[i]
    return rest == np.float32(0.0)


@njit(**INNER)
def _rows(values: NDArray[np.float32], first: int, last: int) -> bool:
    """Return whether ``values[first:last]`` of an array of any shape, its rows side by side, are finite."""
    length = values.size // max(values.shape[0], 1)
    return _between(values.reshape(-1), first * length, last * length)


@njit(**INNER)
def rows_finite(
    first: int,
    last: int,
    means: NDArray[np.float32],
    quats: NDArray[np.float32],
    scales: NDArray[np.float32],
    opacities: NDArray[np.float32],
    sh: NDArray[np.float32],
    channels: NDArray[np.float32],
) -> bool:
    """Return whether all that is given of Gaussians `first` to `last`, or all its gradients, are finite."""
    return (
        _rows(means, first, last)
        and _rows(quats, first, last)
        and _rows(scales, first, last)
        and _rows(opacities, first, last)
        and _rows(sh, first, last)
        and _rows(channels, first, last)
    )


@njit(**JIT)
def _all_finite(values: NDArray[np.float32]) -> bool:
    return _between(values, 0, values.shape[0])


def all_finite(values: NDArray[np.floating]) -> bool:
    """Return whether no value of an array of any shape is infinite or NaN."""
    if values.dtype == np.float32 and values.flags.c_contiguous:
        return bool(_all_finite(values.reshape(-1)))
    return bool(np.isfinite(values).all())
