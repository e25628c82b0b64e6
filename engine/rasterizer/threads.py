"""Kernels on several threads, which take ranges of items from shared counters.

Kernels release Python's global lock. Each thread has its own part of the items, the same part in every kernel of an
image, so that its cache still contains what it wrote before. When its own part is done, it takes items from the parts
of the other threads, so that a core that another program slows down does less. Results depend neither on the number of
threads nor on which thread processed an item.

Numba's own parallel loops are not used: without TBB and OpenMP they abort the process when two Python threads use them
at the same time.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any, NamedTuple, TypeVar

import numpy as np
from llvmlite import ir
from numba import njit
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from ..core.system import usable_cores
from .jit import INNER

T = TypeVar("T")

_CACHE_LINE = 8
"""Length of a row of counters in int64, 64 bytes. Two threads' counters on one cache line would slow both down."""


class Share(NamedTuple):
    """The argument by which a thread takes its share of the items of a kernel, see `take_range`.

    Attributes
    ----------
    counters : int64 array of shape [n_threads, 8]
        The first entry of row k counts how many ranges of thread k's part have been taken. All threads share the array.
    thread : int
        Number of this thread.
    """

    counters: NDArray[np.int64]
    thread: int


def new_counters(n_threads: int | None) -> NDArray[np.int64]:
    """Return `Share.counters` for a kernel on `n_threads` threads, or on all usable cores if None."""
    return np.zeros((n_threads or len(usable_cores()), _CACHE_LINE), np.int64)


@lru_cache(maxsize=8)
def _worker_threads(n: int) -> tuple[ThreadPoolExecutor, ...]:
    """Return `n` pools of one thread each, so that the same part always runs on the same thread."""
    return tuple(ThreadPoolExecutor(1, thread_name_prefix="raster") for _ in range(n))


def run_shared(work: Callable[[Share], T], n_threads: int | None) -> list[T]:
    """Call ``work(share)`` on `n_threads` threads, or on all usable cores if None, and return the results.

    The kernel that `work` calls takes items with `take_range`. If a call raises, its exception is raised here after all
    calls have ended.
    """
    counters = new_counters(n_threads)
    workers = _worker_threads(len(counters) - 1)
    futures = [worker.submit(work, Share(counters, k)) for k, worker in enumerate(workers, 1)]
    try:
        own_result = work(Share(counters, 0))
    finally:
        errors = [future.exception() for future in futures]
    for error in errors:
        if error is not None:
            raise error
    return [own_result, *(future.result() for future in futures)]


@intrinsic
def _fetch_and_add(typing: Any, counters: Any, part: Any) -> Any:
    """Increase ``counters[part, 0]`` by one in an atomic operation and return its previous value."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(counters)(context, builder, args[0]).data
        int64 = ir.IntType(64)
        row = builder.mul(context.cast(builder, args[1], sig.args[1], types.int64), int64(_CACHE_LINE))
        return builder.atomic_rmw("add", builder.gep(data, [row]), int64(1), "monotonic")

    return types.int64(counters, part), emit


@njit(**INNER)
def take_range(share: Share, n: int, size: int) -> tuple[int, int]:
    """Take the next `size` of `n` items; return the first item and the end, which are equal if no item is left.

    No other thread takes these items. The thread's own part comes first, then what is left of the other threads' parts.
    Items are taken in ranges because neighbours often write to neighbouring memory, and two cores that write to the
    same cache line wait for each other. This is not a generator because Numba's generators leaked memory in every call
    of a kernel.
    """
    n_parts = share.counters.shape[0]
    n_ranges = (n + size - 1) // size
    for k in range(n_parts):
        part = (share.thread + k) % n_parts
        index = part * n_ranges // n_parts + _fetch_and_add(share.counters, part)
        if index < (part + 1) * n_ranges // n_parts:
            return index * size, min(index * size + size, n)
    return n, n
