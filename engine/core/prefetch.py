"""Work in a thread, one item ahead of who uses the results."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def prefetched(work: Callable[[_Item], _Result], items: Iterable[_Item]) -> Iterator[_Result]:
    """Yield what `work` returns for each item, in their order.

    One thread calls it, for one item at a time, while the caller uses the result before. Items are taken in the thread
    of the caller. At most two results are in memory.

    Parameters
    ----------
    work : callable
        What it raises is raised in place of its result.
    items : iterable
    """
    begun: Future[_Result] | None = None
    with ThreadPoolExecutor(1) as thread:
        for item in items:
            before, begun = begun, thread.submit(work, item)
            if before is not None:
                yield before.result()
        if begun is not None:
            yield begun.result()
