"""Lower bound on the time of blending: the time of the same number of operations if all of them were FMAs."""

from __future__ import annotations

import time

import numpy as np
from numba import njit
from numpy.typing import NDArray

from engine.rasterizer.jit import JIT
from engine.rasterizer.simd import fma, load, store
from engine.rasterizer.threads import Share, run_shared

_CHAINS = 8
"""Number of independent sums, which hide the latency of an FMA."""

FORWARD, BACKWARD = 28, 52
"""Operations for a pixel and a Gaussian besides those for channels; an FMA counts as two. Forward: offsets 2, whitened
distance 4, its square 3, power of two 14, alpha 2, transmittance 2, weight 1. Backward: the same again, then 2 for the
ratio of alphas, 2 for sums, 6 for the distance again and 14 for six moments and the sum over the Gaussians behind."""
_PER_CHANNEL = 2 + 4
"""Operations for a channel. Forward: one FMA. Backward: two, for the product with the incoming gradient and for the
gradient of the colour."""


@njit(**JIT)
def _compute_fmas(n: int, x: NDArray[np.float32]) -> None:
    """Compute `n` times `_CHAINS` FMAs on vectors from the 32 numbers `x`, which change."""
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


def arithmetic_floor_ms(n_operations: float) -> float:
    """Return the CPU milliseconds that one core currently needs for `n_operations` if all are FMAs on vectors."""
    x = np.full(32, 0.5, np.float32)
    _compute_fmas(10, x)
    x[:] = 0.5
    start = time.process_time()
    _compute_fmas(round(n_operations / (_CHAINS * 16 * 2)), x)
    return 1e3 * (time.process_time() - start)


def time_fmas_ms(n_threads: int) -> float:
    """Return the wall milliseconds of a fixed number of FMAs on `n_threads` threads, a measure of the free cores."""
    n_per_thread = 2_000_000 // n_threads

    def work(_: Share) -> None:
        _compute_fmas(n_per_thread, np.full(32, 0.5, np.float32))

    _compute_fmas(10, np.full(32, 0.5, np.float32))
    start = time.perf_counter()
    run_shared(work, n_threads)
    return 1e3 * (time.perf_counter() - start)


def count_operations(masks: NDArray[np.uint16], n_channels: int) -> float:
    """Return the number of operations of one forward and backward pass.

    Parameters
    ----------
    masks : uint16 array of shape [M]
        Blocks of 4x4 pixels that each pair of a tile and a Gaussian changes, one bit for each block.
    n_channels : int
    """
    n_blocks = int(np.bitwise_count(masks).sum())
    return n_blocks * 16 * (FORWARD + BACKWARD + _PER_CHANNEL * n_channels)
