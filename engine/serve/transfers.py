"""Which request works on an upload, and the threads that do the work of uploads."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from anyio import CapacityLimiter

from .unfinished import Upload

_WRITERS, _CHECKERS = 4, 1
"""Threads that write parts, and that check complete files: decoding a photo takes memory. Others answer requests."""


class Transfers:
    """The requests that hold an upload: one at a time for each. Used by the event loop alone."""

    def __init__(self) -> None:
        self._holders: dict[Upload, _Holder] = {}
        self.writers = CapacityLimiter(_WRITERS)
        self.checkers = CapacityLimiter(_CHECKERS)

    @asynccontextmanager
    async def held(self, upload: Upload) -> AsyncIterator[asyncio.Future[None]]:
        """Hold an upload, after the request that holds it now was asked to end.

        A client that lost its connection comes back before the server has noticed. The future that is yielded is
        done when a later request wants the upload.
        """
        while (holder := self._holders.get(upload)) is not None:
            if not holder.wanted.done():
                holder.wanted.set_result(None)
            await holder.ended.wait()
        holder = self._holders[upload] = _Holder()
        try:
            yield holder.wanted
        finally:
            del self._holders[upload]
            holder.ended.set()

    def is_held(self, upload: Upload) -> bool:
        """Return whether a request works on an upload."""
        return upload in self._holders


class _Holder:
    def __init__(self) -> None:
        self.wanted: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.ended = asyncio.Event()
