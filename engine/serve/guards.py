"""Checks that every request passes first: limits on bodies and slow clients, and headers that browsers obey.

Plain ASGI, because Starlette's own base class for middleware would hold back streams.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator, MutableMapping
from typing import Any

from .access import CLAIM
from .connections import Connections
from .settings import ServeSettings

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Message, Receive, Send], Awaitable[None]]

_HEADERS = {
    "content-security-policy": "default-src 'self'; img-src 'self' blob: data:; worker-src 'self' blob:; "
    "script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; connect-src 'self' blob: data:; object-src 'none'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "geolocation=(), microphone=(), payment=()",
}
_YEAR = 31_536_000
UPLOADS = "/api/v1/uploads"
"""Where uploads are sent."""
TUS_VERSION = "1.0.0"


class SecurityHeaders:
    """Adds the headers to each response that does not set them itself."""

    def __init__(self, app: App, settings: ServeSettings) -> None:
        self._app = app
        self._headers = dict(_HEADERS)
        if settings.lan:
            self._headers["strict-transport-security"] = f"max-age={_YEAR}"

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Handle one request."""

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                present = {name.decode("latin-1").lower() for name, _ in message["headers"]}
                added = [
                    (name.encode(), value.encode()) for name, value in self._headers.items() if name not in present
                ]
                # The protocol wants it in every answer, refusals too.
                added += [(b"tus-resumable", TUS_VERSION.encode())] if scope.get("path", "").startswith(UPLOADS) else []
                message["headers"] = [*message["headers"], *added]
            await send(message)

        await self._app(scope, receive, with_headers)


class RequestLimits:
    """Refuses bodies that are too large, clients that send too slowly, and too many requests of a user at a time."""

    def __init__(self, app: App, settings: ServeSettings, connections: Connections | None = None) -> None:
        self._app = app
        self._settings = settings
        self._connections = connections
        self._of_user: Counter[str] = Counter()
        # Handlers claim in other threads.
        self._lock = threading.Lock()

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        settings = self._settings
        is_upload = scope["method"] == "PATCH" and scope["path"].startswith(UPLOADS)
        limit = settings.max_video_bytes if is_upload else settings.max_body_bytes
        stated = dict(scope["headers"]).get(b"content-length", b"0")
        if not stated.isdigit() or len(stated) > 18 or int(stated) > limit:
            await _refuse(send, 413, f"The request is larger than {limit:,} bytes.")
            return
        received, ended, started = 0, False, False
        clock = asyncio.get_running_loop().time
        begin = clock()

        async def limited() -> Message:
            nonlocal received, ended
            if ended:
                return await receive()
            # An upload may take long, but not without end; any other request is small.
            more = received / settings.min_upload_rate if is_upload else 0.0
            left = begin + settings.read_seconds + more - clock()
            try:
                message = await asyncio.wait_for(receive(), max(0.0, min(left, settings.read_seconds)))
            except TimeoutError:
                ended = True
                return {"type": "http.disconnect"}
            received += len(message.get("body", b""))
            ended = message["type"] != "http.request" or not message.get("more_body", False)
            if received > limit:
                ended = True
                return {"type": "http.disconnect"}
            return message

        async def noted(message: Message) -> None:
            nonlocal started
            started = True
            await send(message)

        with self._counted(scope):
            await self._app(scope, limited, noted)
        if not started:
            await _refuse(send, 408, "The request did not arrive in time.")

    @contextlib.contextmanager
    def _counted(self, scope: Message) -> Iterator[None]:
        """Let the request be counted for its user, once that is known."""
        users: list[str] = []

        def claim(user: str) -> bool:
            """Return whether the user may have one more request."""
            if users:
                return True
            with self._lock:
                if self._of_user[user] >= self._settings.max_user_requests:
                    return False
                self._of_user[user] += 1
            users.append(user)
            if self._connections is not None and scope.get("client"):
                loop.call_soon_threadsafe(self._connections.works, tuple(scope["client"][:2]))
            return True

        loop = asyncio.get_running_loop()
        scope[CLAIM] = claim
        try:
            yield
        finally:
            with self._lock:
                for user in users:
                    self._of_user[user] -= 1
                    if not self._of_user[user]:
                        del self._of_user[user]


async def _refuse(send: Send, status: int, sentence: str) -> None:
    body = json.dumps({"detail": sentence}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": [*headers, (b"connection", b"close")]})
    await send({"type": "http.response.body", "body": body})
