"""Kernels that release Python's lock, run on a few threads. Each begins with a part of its own, the same in every kernel
of a picture, so that its cache still holds what it wrote before; then it helps the others, so that a core which another
program slows down does less. Results never depend on how many threads there are, nor on who did what."""

from __future__ import annotations

import os
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

from .jit import INNER

__all__ = ["Share", "nothing_taken", "n_usable_cores", "run_shared", "take"]

T = TypeVar("T")

_CACHE_LINE = 8  # int64


class Share(NamedTuple):
    """What a thread needs to know of a work to do its share of it.

    Attributes
    ----------
    taken : int64 [n_threads, 8]
        First of each row: how much of that thread's own part has been handed out. The same array for all threads.
    own : int
        Number of this thread.
    """

    taken: NDArray[np.int64]
    own: int


def nothing_taken(n_threads: int | None) -> NDArray[np.int64]:
    """Return `Share.taken` of a work that begins, for `n_threads` threads, all usable cores by default."""
    return np.zeros((n_threads or n_usable_cores(), _CACHE_LINE), np.int64)


def n_usable_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@lru_cache(maxsize=8)
def _helpers(n: int) -> tuple[ThreadPoolExecutor, ...]:
    """Return `n` threads; a pool of one each, so that a part of a work always goes to the same of them."""
    return tuple(ThreadPoolExecutor(1, thread_name_prefix="raster") for _ in range(n))


def run_shared(work: Callable[[Share], T], n_threads: int | None) -> list[T]:
    """Call ``work(share)`` on `n_threads` threads, all usable cores by default; its kernel does what it can `take`.

    Returns what each call returned.

    Numba's own parallel loops are not used: where TBB and OpenMP are missing, they abort the process when two Python
    threads use them at once. The first exception of a call is raised here, after all calls ended.
    """
    taken = nothing_taken(n_threads)
    helpers = _helpers(len(taken) - 1)
    futures = [helper.submit(work, Share(taken, k)) for k, helper in enumerate(helpers, 1)]
    try:
        own = work(Share(taken, 0))
    finally:
        errors = [future.exception() for future in futures]
    for error in errors:
        if error is not None:
            raise error
    return [own, *(future.result() for future in futures)]


@intrinsic
def _count(typing: Any, taken: Any, part: Any) -> Any:
    """Raise ``taken[part, 0]`` by one in one indivisible operation, and return what it was."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(taken)(context, builder, args[0]).data
        int64 = ir.IntType(64)
        row = builder.mul(context.cast(builder, args[1], sig.args[1], types.int64), int64(_CACHE_LINE))
        return builder.atomic_rmw("add", builder.gep(data, [row]), int64(1), "monotonic")

    return types.int64(taken, part), emit


@njit(**INNER)
def take(share: Share, n: int, at_once: int) -> tuple[int, int]:
    """Take the next `at_once` of `n` items; return the first and the end, the same if none is left.

    No other thread takes them: first this thread's own part is handed out, then what is left of those of the others.

    A thread takes neighbours together: they often write side by side, and two cores that write to one cache line wait
    for each other. No generator makes a neater loop of it: with one, Numba kept memory at every call of a kernel.
    """
    n_parts = share.taken.shape[0]
    n_blocks = (n + at_once - 1) // at_once
    for k in range(n_parts):
        part = (share.own + k) % n_parts
        block = part * n_blocks // n_parts + _count(share.taken, part)
        if block < (part + 1) * n_blocks // n_parts:
            return block * at_once, min(block * at_once + at_once, n)
    return n, n
