"""The free workers of a cluster as helpers of an engine that runs on another one; see `engine.core.shares`.

What is sent is the arguments and results of shares, some kilobytes each. Everything else is in the shared folders.
"""

from __future__ import annotations

import contextlib
import time
import uuid
from collections.abc import Sequence
from typing import Any

from distributed import Client, get_worker

from ... import __version__
from ...core.child_process import ChildrenBeside
from ...core.errors import HeritageError
from ...core.shares import Arguments, Need
from ...core.system import given_cores
from .cluster import MEMORY, worker_resources

_LOOK_SECONDS = 1.0
"""Seconds between two looks at the workers."""
_BEGIN_SECONDS = 15.0
"""Seconds until a share must have begun: somebody else may have given its worker a stage meanwhile."""
_POLL_SECONDS = 0.2


class ClusterHelpers:
    """The workers of a scheduler that have nothing to do. A worker on which a share failed helps no more.

    Parameters
    ----------
    address : str
        Of the scheduler.
    """

    def __init__(self, address: str) -> None:
        self._client = Client(address, set_as_default=False)
        self._topic = f"gaussian-heritage-shares-{uuid.uuid4().hex}"
        self._looked_at = float("-inf")
        self._resources: dict[str, dict[str, float]] = {}
        self._cores: dict[str, int] = {}
        self._busy: set[str] = set()
        self.begun: set[str] = set()
        self.failed: set[str] = set()
        self._client.subscribe_topic(self._topic, lambda event: self.begun.add(event[1]))

    def free(self) -> Sequence[_Worker]:
        """See `Helpers`."""
        self._look()
        return [
            _Worker(self, address, self._cores[address], int(has.get(MEMORY, 0)))
            for address, has in self._resources.items()
            if address not in self._busy | self.failed
        ]

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
                self._cores |= self._client.run(_count_cores, workers=[one for one in found if one not in self._cores])
                self._resources = found

    def submit(self, address: str, function: str, shares: Sequence[Arguments], need: Need, what: str) -> Any:
        """Give shares to a worker that has nothing to do, and return their future."""
        self._busy.add(address)
        return self._client.submit(
            _call_shares, __version__, self._topic, function, list(shares), what,
            key=f"shares-{uuid.uuid4().hex}", workers=[address], resources={MEMORY: need.memory * len(shares)},
            # Before stages that wait for the same worker, so that another engine does not wait for them.
            priority=1, pure=False,
        )  # fmt: skip


class _Worker:
    """A worker that has nothing to do; see `Helper`."""

    def __init__(self, helpers: ClusterHelpers, address: str, cores: int, memory: int) -> None:
        self._helpers, self._address = helpers, address
        self._cores, self._memory = cores, memory

    def places(self, need: Need) -> int:
        """See `Helper`."""
        return min(max(1, self._cores // need.cores), self._memory // need.memory)

    def begin(self, function: str, shares: Sequence[Arguments], need: Need, *, what: str) -> _Call:
        """See `Helper`."""
        return _Call(self._helpers, self._address, self._helpers.submit(self._address, function, shares, need, what))


class _Call:
    """Shares on a worker; see `HelperCall`."""

    def __init__(self, helpers: ClusterHelpers, address: str, future: Any) -> None:
        self._helpers, self._address, self._future = helpers, address, future
        self._begin_until = time.monotonic() + _BEGIN_SECONDS

    @property
    def finished(self) -> bool:
        """See `HelperCall`."""
        late = self._future.key not in self._helpers.begun and time.monotonic() > self._begin_until
        return late or not self._helpers.is_connected(self._address) or bool(self._future.done())

    def results(self) -> list[Any] | None:
        """See `HelperCall`."""
        found: list[Any] | None = None
        if self._future.status == "finished":
            with contextlib.suppress(Exception):  # the worker is gone that holds the results
                found = self._future.result(timeout=_BEGIN_SECONDS)
        if found is None:
            self._helpers.failed.add(self._address)
        self.end()
        return found

    def end(self) -> None:
        """See `HelperCall`."""
        with contextlib.suppress(Exception):  # the scheduler is gone
            self._future.cancel()


def _count_cores() -> int:
    return len(given_cores())


def _call_shares(version: str, topic: str, function: str, shares: list[Arguments], what: str) -> list[Any] | None:
    """Call a function for each share in child processes of a worker; return None when that fails or nobody waits."""
    worker = get_worker()
    key = worker.get_current_task()
    worker.log_event(topic, key)
    if version != __version__:
        return None
    with ChildrenBeside() as work:
        for arguments in shares:
            work.begin(function, arguments, what=what)
        children = work.take()
        while not all(child.finished for child in children):
            # Dask does not end what it forgets.
            if worker.state.tasks[key].state != "executing":
                return None
            time.sleep(_POLL_SECONDS)
        try:
            return [child.end() for child in children]
        except (HeritageError, ModuleNotFoundError):
            # The engine that asked says what is wrong if it happens there too.
            return None
