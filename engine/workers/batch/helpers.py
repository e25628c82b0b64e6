"""The free workers of a cluster as helpers of an engine that runs on another one.

The classes are the `Helpers`, `Helper` and `HelperCall` of `engine.core.shares`, whose methods are described there.
What is sent is the arguments of a function, some kilobytes. Everything else is in the shared folders.
"""

from __future__ import annotations

import contextlib
import time
import uuid
from collections.abc import Sequence
from typing import Any

from distributed import Client, Future, get_worker

from ... import __version__
from ...core.child_process import ChildrenBeside
from ...core.errors import HeritageError
from ...core.shares import Need
from ...core.system import given_cores
from .cluster import MEMORY, worker_resources

_LOOK_SECONDS = 1.0
"""Seconds between two looks at the workers."""
_POLL_SECONDS = 0.2


class ClusterHelpers:
    """The workers of a scheduler that have nothing to do. A worker that failed helps no more.

    Parameters
    ----------
    address : str
        Of the scheduler.

    Attributes
    ----------
    begun : set of str
        Keys of the tasks that a worker has begun with.
    """

    def __init__(self, address: str) -> None:
        self._client = Client(address, set_as_default=False)
        self._topic = f"gaussian-heritage-shares-{uuid.uuid4().hex}"
        self._looked_at = float("-inf")
        self._resources: dict[str, dict[str, float]] = {}
        self._cores: dict[str, int] = {}
        self._busy: set[str] = set()
        self.begun: set[str] = set()
        self._given: list[tuple[str, Future[Any]]] = []
        self._client.subscribe_topic(self._topic, lambda event: self.begun.add(event[1]))  # time, key

    def free(self) -> Sequence[_Worker]:
        """See `Helpers`."""
        self._look()
        unusable = self._busy | self.failed
        return [
            _Worker(self, address, self._cores[address], int(has.get(MEMORY, 0)))
            for address, has in self._resources.items()
            if address not in unusable
        ]

    @property
    def failed(self) -> set[str]:
        """Addresses of the workers whose task failed."""
        return {address for address, future in self._given if future.status == "error"}

    def is_connected(self, address: str) -> bool:
        """Return whether a worker is connected."""
        self._look()
        return address in self._resources

    def _look(self) -> None:
        """Look which workers are connected and what they do, unless that was done just now."""
        if time.monotonic() - self._looked_at < _LOOK_SECONDS:
            return
        self._looked_at = time.monotonic()
        self._resources, self._busy = {}, set()
        if self._client.status == "running":
            with contextlib.suppress(OSError, TimeoutError):
                self._busy = {address for address, tasks in self._client.processing().items() if tasks}
                found = worker_resources(self._client)
                new = [address for address in found if address not in self._cores]
                self._cores |= self._client.run(_count_cores, workers=new, on_error="ignore")
                self._resources = {address: has for address, has in found.items() if address in self._cores}

    def submit(
        self, address: str, function: str, arguments: dict[str, Any], count: int, need: Need, what: str
    ) -> Future[Any]:
        """Give processes to a worker that has nothing to do, and return their future."""
        self._busy.add(address)
        future: Future[Any] = self._client.submit(
            _run_on_worker, __version__, self._topic, function, arguments, count, what,
            key=f"shares-{uuid.uuid4().hex}", workers=[address], resources={MEMORY: need.memory * count},
            # Before stages that wait for the same worker, so that another engine does not wait for them.
            priority=1, pure=False,
        )  # fmt: skip
        self._given.append((address, future))
        return future


class _Worker:
    """A worker that has nothing to do; see `Helper`."""

    def __init__(self, helpers: ClusterHelpers, address: str, cores: int, memory: int) -> None:
        self._helpers, self._address = helpers, address
        self._cores, self._memory = cores, memory

    def places(self, need: Need) -> int:
        """See `Helper`."""
        return min(max(1, self._cores // need.cores), self._memory // need.memory)

    def begin(self, function: str, arguments: dict[str, Any], count: int, need: Need, *, what: str) -> _Call:
        """See `Helper`."""
        future = self._helpers.submit(self._address, function, arguments, count, need, what)
        return _Call(self._helpers, self._address, future)


class _Call:
    """Processes on a worker; see `HelperCall`."""

    def __init__(self, helpers: ClusterHelpers, address: str, future: Future[Any]) -> None:
        self._helpers, self._address, self._future = helpers, address, future

    @property
    def works(self) -> bool:
        """See `HelperCall`."""
        if self._future.done():
            return False
        return self._future.key in self._helpers.begun and self._helpers.is_connected(self._address)

    def end(self) -> None:
        """See `HelperCall`."""
        with contextlib.suppress(Exception):  # the scheduler is gone
            self._future.cancel()


def _count_cores() -> int:
    return len(given_cores())


def _run_on_worker(version: str, topic: str, function: str, arguments: dict[str, Any], count: int, what: str) -> None:
    """Call a function in child processes of a worker, until they end or nobody waits for them.

    Raises
    ------
    RuntimeError
        When that fails. The engine that asked then does the work itself, and reports what fails there, too.
    """
    worker = get_worker()
    key = worker.get_current_task()
    worker.log_event(topic, key)
    if version != __version__:
        raise RuntimeError(f"This worker has version {__version__} of the engine, and not {version}.")
    with ChildrenBeside() as work:
        for _ in range(count):
            work.begin(function, arguments, what=what)
        children = work.take()
        # Dask forgets a task that was cancelled or whose client is gone, and lets its function run.
        while worker.state.tasks[key].state == "executing" and not all(child.finished for child in children):
            time.sleep(_POLL_SECONDS)
        try:
            for child in children:
                child.end()
        except HeritageError as error:
            # Its own kind may not be known to Dask.
            raise RuntimeError(str(error)) from None
