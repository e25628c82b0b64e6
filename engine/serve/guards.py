"""What every request passes first: limits on bodies and slow clients, and headers that browsers obey.

Plain ASGI, because Starlette's own base class for middleware would hold back streams.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from .settings import ServeSettings

__all__ = ["SecurityHeaders", "RequestLimits"]

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
                message["headers"] = [*message["headers"], *added]
            await send(message)

        await self._app(scope, receive, with_headers)


class RequestLimits:
    """Refuses bodies that are too large, and clients that send nothing for too long."""

    def __init__(self, app: App, settings: ServeSettings) -> None:
        self._app = app
        self._settings = settings

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        is_upload = scope["method"] in ("PATCH", "POST") and scope["path"].startswith("/api/v1/uploads")
        limit = self._settings.max_video_bytes if is_upload else self._settings.max_body_bytes
        stated = dict(scope["headers"]).get(b"content-length", b"0")
        if not stated.isdigit() or len(stated) > 18 or int(stated) > limit:
            await _refuse(send, 413, f"The request is larger than {limit:,} bytes.")
            return
        received, ended, started = 0, False, False

        async def limited() -> Message:
            nonlocal received, ended
            if ended:
                return await receive()
            try:
                message = await asyncio.wait_for(receive(), self._settings.read_seconds)
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

        await self._app(scope, limited, noted)
        if not started:
            await _refuse(send, 408, "The request did not arrive in time.")


async def _refuse(send: Send, status: int, sentence: str) -> None:
    body = json.dumps({"detail": sentence}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": [*headers, (b"connection", b"close")]})
    await send({"type": "http.response.body", "body": body})
