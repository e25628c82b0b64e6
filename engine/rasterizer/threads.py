"""Kernels that release Python's lock, run on a few threads over interleaved ranges; results never depend on how many."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

__all__ = ["n_usable_cores", "run_ranges", "split_ranges"]


def n_usable_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@lru_cache(maxsize=8)
def _pool(n_threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(n_threads, thread_name_prefix="raster")


def run_ranges(work: Callable[[int, int], None], n_threads: int | None) -> None:
    """Call ``work(i, n)`` for i in 0..n-1 on n threads; each call takes items i, i + n, i + 2n, ...

    Numba's own parallel loops are not used: where TBB and OpenMP are missing, they abort the process when two Python
    threads use them at once. The first exception of a call is raised here, after all calls ended.
    """
    n = n_threads or n_usable_cores()
    if n == 1:
        work(0, 1)
        return
    pool = _pool(n)
    futures = [pool.submit(work, i, n) for i in range(1, n)]
    try:
        work(0, n)
    finally:
        errors = [future.exception() for future in futures]
    for error in errors:
        if error is not None:
            raise error


def split_ranges(n_items: int, i: int, n: int) -> tuple[int, int]:
    """Return the i-th of n contiguous ranges ``start, stop`` that together cover ``range(n_items)``."""
    return n_items * i // n, n_items * (i + 1) // n
