"""Kernels that release Python's lock, run on a few threads that fetch their shares as they go, so that a core which
another program slows down does less; results never depend on how many threads there are, nor on who did what."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from . import jit  # noqa: F401  (sets Numba up before its first use)

__all__ = ["Taken", "n_usable_cores", "run_shared", "take"]

T = TypeVar("T")

Taken = NDArray[np.int64]
"""One number: how many items of a work have been handed out."""


def n_usable_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@lru_cache(maxsize=8)
def _pool(n_threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(n_threads, thread_name_prefix="raster")


def run_shared(work: Callable[[Taken], T], n_threads: int | None) -> list[T]:
    """Call ``work(taken)`` on `n_threads` threads, all usable cores by default; its kernel does what it can `take`.

    Returns what each call returned.

    Numba's own parallel loops are not used: where TBB and OpenMP are missing, they abort the process when two Python
    threads use them at once. The first exception of a call is raised here, after all calls ended.
    """
    n = n_threads or n_usable_cores()
    taken = np.zeros(1, np.int64)
    futures = [_pool(n).submit(work, taken) for _ in range(1, n)]
    try:
        own = work(taken)
    finally:
        errors = [future.exception() for future in futures]
    for error in errors:
        if error is not None:
            raise error
    return [own, *(future.result() for future in futures)]


@intrinsic
def take(typing: Any, taken: Any, n: Any) -> Any:
    """Take the next `n` items of a work, ``taken[0]`` to ``taken[0] + n``, and return the first of them.

    `taken` is raised by `n` in one indivisible operation, so that no other thread takes the same ones. A thread takes
    neighbours together: they often write side by side, and two cores that write to one cache line wait for each other.
    No generator makes a neater loop of it: with one, Numba kept memory at every call of a kernel.
    """

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(taken)(context, builder, args[0]).data
        n64 = context.cast(builder, args[1], sig.args[1], types.int64)
        return builder.atomic_rmw("add", builder.bitcast(data, ir.IntType(64).as_pointer()), n64, "monotonic")

    return types.int64(taken, n), emit
