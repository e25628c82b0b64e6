"""Streams of events: how many a user and a browser may have.

Over HTTP/1.1 a browser has six connections to a server, for all its tabs. If each tab kept one for its events, the
sixth could load nothing more. So a browser gives its streams a name of its own, and a new one takes the place of the
oldest, whose tab then asks from time to time instead.
"""

from __future__ import annotations

import asyncio
from collections import Counter, OrderedDict
from collections.abc import AsyncIterator

from fastapi import HTTPException
from fastapi.responses import StreamingResponse

from .feeds import Feeds
from .library import WebProject
from .settings import ServeSettings

_MAX_DIGITS = 20
_DISPLACED = "event: displaced\ndata: {}\n\n"


class Streams:
    """The open streams of a server; used by the event loop alone."""

    def __init__(self, settings: ServeSettings, feeds: Feeds) -> None:
        self._settings = settings
        self._feeds = feeds
        self._of_user: Counter[str] = Counter()
        self._of_browser: dict[tuple[str, str], OrderedDict[asyncio.Event, None]] = {}

    def begin(self, project: WebProject, user: str, last_event_id: str, browser: str = "") -> StreamingResponse:
        """Return a stream of the events of `project` after `last_event_id`.

        Parameters
        ----------
        browser : str
            The browser's name for itself; empty: its streams are not counted.

        Raises
        ------
        HTTPException
            When the user has too many streams.
        """
        if self._of_user[user] >= self._settings.max_streams:
            raise HTTPException(429, "Too many pages are open. Close some of them.")
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        last_number = int(last_event_id) if last_event_id.isdecimal() and len(last_event_id) < _MAX_DIGITS else 0
        content = self._counted(project, user, last_number, browser)
        return StreamingResponse(content, media_type="text/event-stream", headers=headers)

    async def _counted(self, project: WebProject, user: str, last_number: int, browser: str) -> AsyncIterator[str]:
        displaced = asyncio.Event()
        key = (user, browser)
        others = self._of_browser.setdefault(key, OrderedDict()) if browser else OrderedDict()
        while len(others) >= self._settings.max_browser_streams:
            others.popitem(last=False)[0].set()
        others[displaced] = None
        self._of_user[user] += 1
        try:
            async for text in self._feeds.stream(project.folder, last_number, displaced):
                yield text
            yield _DISPLACED
        finally:
            self._of_user[user] -= 1
            others.pop(displaced, None)
            if not others and self._of_browser.get(key) is others:
                del self._of_browser[key]
