"""The least time the arithmetic of blending can take: as many operations as must be done, all of them FMAs."""

from __future__ import annotations

import time

import numpy as np
from numba import njit
from numpy.typing import NDArray

from engine.rasterizer.jit import JIT
from engine.rasterizer.simd import fma, load, store
from engine.rasterizer.threads import Share, run_shared

__all__ = ["least_time", "operations", "spin_on"]

_CHAINS = 8
"""Independent sums, so that the latency of one FMA is hidden."""

FORWARD, BACKWARD = 28, 52
"""Operations a pixel-Gaussian pair besides its channels, an FMA counting two: offsets 2, whitened distance 4, its
square 3, power of two 14, alpha 2, transmittance 2, weight 1; backward the same again, then 2 for the ratio of alphas,
2 to sum, 6 for the distance once more and 14 for six moments and what lies behind."""
_PER_CHANNEL = 2 + 4
"""Forward one FMA a channel; backward two: the product with the incoming gradient, and the colour's own gradient."""


@njit(**JIT)
def _spin(n: int, x: NDArray[np.float32]) -> None:
    """Do `n` times `_CHAINS` FMAs on the 32 numbers `x`, which are changed."""
    a, b = load(x, 0), load(x, 16)
    s0, s1, s2, s3, s4, s5, s6, s7 = a, a, a, a, a, a, a, a
    for _ in range(n):
        s0 = fma(s0, b, a)
        s1 = fma(s1, b, a)
        s2 = fma(s2, b, a)
        s3 = fma(s3, b, a)
        s4 = fma(s4, b, a)
        s5 = fma(s5, b, a)
        s6 = fma(s6, b, a)
        s7 = fma(s7, b, a)
    store(x, 0, ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7)))


def least_time(n_operations: float) -> float:
    """Return the CPU milliseconds in which one core does so many operations right now, all of them FMAs on vectors."""
    x = np.full(32, 0.5, np.float32)
    _spin(10, x)
    x[:] = 0.5
    start = time.process_time()
    _spin(round(n_operations / (_CHAINS * 16 * 2)), x)
    return 1e3 * (time.process_time() - start)


def spin_on(n_threads: int) -> float:
    """Return the wall milliseconds of the same FMAs shared between threads: what the machine's cores give right now."""
    each = 2_000_000 // n_threads

    def work(_: Share) -> None:
        _spin(each, np.full(32, 0.5, np.float32))

    _spin(10, np.full(32, 0.5, np.float32))
    start = time.perf_counter()
    run_shared(work, n_threads)
    return 1e3 * (time.perf_counter() - start)


def operations(masks: NDArray[np.uint16], n_channels: int) -> float:
    """Return the operations of one forward and backward pass.

    Parameters
    ----------
    masks : array of shape [M], uint16
        Blocks of 4x4 pixels that each pair of a tile and a Gaussian changes.
    n_channels : int
    """
    n_blocks = int(np.bitwise_count(masks).sum())
    return n_blocks * 16 * (FORWARD + BACKWARD + _PER_CHANNEL * n_channels)
