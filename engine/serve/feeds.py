"""What happens in each project, sent to the browsers that watch it (server-sent events).

Each event is complete in itself, so a browser that was away needs the newest of each kind and nothing older. Numbers
are nanoseconds of the clock: they rise across restarts of the server, so that Last-Event-ID stays valid.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncIterator
from pathlib import Path

__all__ = ["Feeds"]

_HEARTBEAT_SECONDS = 15.0
"""A comment after this pause tells proxies and the server whether the browser is still there."""


class _Watcher:
    """One browser: wakes its stream from any thread."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self.news = asyncio.Event()

    def wake(self) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self.news.set)


class Feeds:
    """The newest event of each kind, for each project."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._newest: dict[Path, dict[str, tuple[int, str]]] = {}
        self._watchers: dict[Path, set[_Watcher]] = {}

    def publish(self, project: Path, kind: str, data: str = "{}") -> None:
        """Send an event to all who watch the folder `project`, now or later; from any thread."""
        with self._lock:
            self._newest.setdefault(project, {})[kind] = (time.time_ns(), data)
            watchers = list(self._watchers.get(project, ()))
        for watcher in watchers:
            watcher.wake()

    async def stream(self, project: Path, last_number: int) -> AsyncIterator[str]:
        """Yield the events after `last_number` as text of the protocol, and further ones as they happen."""
        watcher = _Watcher()
        with self._lock:
            self._watchers.setdefault(project, set()).add(watcher)
        try:
            yield "retry: 2000\n\n"
            while True:
                watcher.news.clear()
                with self._lock:
                    newest = self._newest.get(project, {})
                    events = sorted(
                        (number, kind, data) for kind, (number, data) in newest.items() if number > last_number
                    )
                for number, kind, data in events:
                    last_number = number
                    yield f"id: {number}\nevent: {kind}\ndata: {data}\n\n"
                try:
                    await asyncio.wait_for(watcher.news.wait(), _HEARTBEAT_SECONDS)
                except TimeoutError:
                    yield ": \n\n"
        finally:
            with self._lock:
                self._watchers[project].discard(watcher)
                if not self._watchers[project]:
                    del self._watchers[project]
