"""Whether every value of an array is finite: looked at in each step, so as fast as memory can be read."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .jit import JIT
from .llvm import LANES
from .simd import any_of, load, splat

__all__ = ["all_finite"]


@njit(**JIT)
def _all_finite(values: NDArray[np.float32]) -> bool:
    n = values.shape[0]
    whole = n - n % LANES
    odd = splat(np.float32(0.0))
    for i in range(0, whole, LANES):
        x = load(values, i)
        odd = odd + (x - x)  # inf - inf and NaN are NaN, and stay so
    if any_of(odd != np.float32(0.0)):
        return False
    rest = np.float32(0.0)
    for i in range(whole, n):
        rest += values[i] - values[i]
    return rest == np.float32(0.0)


def all_finite(values: NDArray[np.floating]) -> bool:
    """Return whether no value of an array of any shape is infinite or NaN."""
    if values.dtype == np.float32 and values.flags.c_contiguous:
        return bool(_all_finite(values.reshape(-1)))
    return bool(np.isfinite(values).all())
