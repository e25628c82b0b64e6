"""Opening a stream of events: how many a user may have, and where it continues."""

from __future__ import annotations

from collections import Counter
from collections.abc import AsyncIterator

from fastapi import HTTPException
from fastapi.responses import StreamingResponse

from .access import Server
from .library import WebProject

__all__ = ["open_stream"]

_open: Counter[str] = Counter()
"""Streams of each user; changed by the event loop alone."""


def open_stream(server: Server, project: WebProject, user: str, last_event_id: str) -> StreamingResponse:
    """Return a stream of the events of `project` after `last_event_id`.

    Raises
    ------
    HTTPException
        When the user has too many streams.
    """
    if _open[user] >= server.settings.max_streams:
        raise HTTPException(429, "Too many pages are open. Close some of them.")
    last_number = int(last_event_id) if last_event_id.isdecimal() and len(last_event_id) < 20 else 0

    async def counted() -> AsyncIterator[str]:
        _open[user] += 1
        try:
            async for text in server.feeds.stream(project.folder, last_number):
                yield text
        finally:
            _open[user] -= 1

    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(counted(), media_type="text/event-stream", headers=headers)
