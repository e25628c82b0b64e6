"""Events of each project, sent to the browsers that watch it (server-sent events).

Each event is complete in itself, so a browser that was away needs the newest of each kind and nothing older. Numbers
rise whatever the clock does: they are its nanoseconds, or one more than the last. A browser whose last number is above
all of this server's comes from a server whose clock was ahead, and gets everything.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncIterator
from pathlib import Path

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
        self._last = 0
        self._newest: dict[Path, dict[str, tuple[int, str]]] = {}
        self._watchers: dict[Path, set[_Watcher]] = {}

    def publish(self, project: Path, kind: str, data: str = "{}") -> None:
        """Send an event to all who watch the folder `project`, now or later; from any thread."""
        with self._lock:
            self._last = max(time.time_ns(), self._last + 1)
            self._newest.setdefault(project, {})[kind] = (self._last, data)
            watchers = list(self._watchers.get(project, ()))
        for watcher in watchers:
            watcher.wake()

    async def stream(self, project: Path, last_number: int, stop: asyncio.Event | None = None) -> AsyncIterator[str]:
        """Yield the events after `last_number` as text of the protocol, and further ones until `stop`."""
        stop = stop or asyncio.Event()
        watcher = _Watcher()
        with self._lock:
            self._watchers.setdefault(project, set()).add(watcher)
            if last_number > self._last:
                last_number = 0
        try:
            yield "retry: 2000\n\n"
            while not stop.is_set():
                watcher.news.clear()
                with self._lock:
                    newest = self._newest.get(project, {})
                    events = sorted(
                        (number, kind, data) for kind, (number, data) in newest.items() if number > last_number
                    )
                for number, kind, data in events:
                    last_number = number
                    yield f"id: {number}\nevent: {kind}\ndata: {data}\n\n"
                waiting = [asyncio.ensure_future(event.wait()) for event in (watcher.news, stop)]
                try:
                    done, _ = await asyncio.wait(
                        waiting, timeout=_HEARTBEAT_SECONDS, return_when=asyncio.FIRST_COMPLETED
                    )
                finally:
                    for one in waiting:
                        one.cancel()
                if not done:
                    yield ": \n\n"
        finally:
            with self._lock:
                self._watchers[project].discard(watcher)
                if not self._watchers[project]:
                    del self._watchers[project]
