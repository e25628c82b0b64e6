"""Tests for values that are not finite. They run in every training step, so they are as fast as memory can be read."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .jit import INNER, JIT
from .llvm import LANES
from .simd import any_of, load, splat


@njit(**INNER)
def _range_finite(values: NDArray[np.float32], start: int, stop: int) -> bool:
    """Return whether the values ``values[start:stop]`` of a flat array are finite."""
    vector_stop = stop - (stop - start) % LANES
    differences = splat(np.float32(0.0))
    for i in range(start, vector_stop, LANES):
        x = load(values, i)
        differences = differences + (x - x)  # inf - inf and NaN - NaN are NaN, and a sum with NaN stays NaN.
    if any_of(differences != np.float32(0.0)):
        return False
    difference = np.float32(0.0)
    for i in range(vector_stop, stop):
        difference += values[i] - values[i]
    return difference == np.float32(0.0)


@njit(**INNER)
def _array_rows_finite(values: NDArray[np.float32], first: int, last: int) -> bool:
    """Return whether the rows ``values[first:last]`` of a contiguous array of any shape are finite."""
    length = values.size // max(values.shape[0], 1)
    return _range_finite(values.reshape(-1), first * length, last * length)


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
    """Return whether the parameters of Gaussians `first` to `last` (exclusive), or their gradients, are finite."""
    return (
        _array_rows_finite(means, first, last)
        and _array_rows_finite(quats, first, last)
        and _array_rows_finite(scales, first, last)
        and _array_rows_finite(opacities, first, last)
        and _array_rows_finite(sh, first, last)
        and _array_rows_finite(channels, first, last)
    )


@njit(**JIT)
def _all_finite(values: NDArray[np.float32]) -> bool:
    return _range_finite(values, 0, values.shape[0])


def all_finite(values: NDArray[np.floating]) -> bool:
    """Return whether every value of an array of any shape and dtype is finite (neither infinite nor NaN)."""
    if values.dtype == np.float32 and values.flags.c_contiguous:
        return bool(_all_finite(values.reshape(-1)))
    return bool(np.isfinite(values).all())
