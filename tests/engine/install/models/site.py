"""A server of one file, reached by https, that can interrupt a download, lie about its size, or serve another file."""

from __future__ import annotations

import contextlib
import hashlib
import select
import socket
import ssl
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from engine.install.models.catalogue import CATALOGUE, ModelFile

CERTIFICATE = Path(__file__).with_name("certificate.pem")
"""Made for 127.0.0.1 and models.invalid, with its key. Only tests trust it, through SSL_CERT_FILE."""


def _field(number: int, data: bytes) -> bytes:
    """A field of Protocol Buffers that holds bytes."""
    length, left = b"", len(data)
    while left >= 0x80:
        length += bytes([left & 0x7F | 0x80])
        left >>= 7
    return bytes([number << 3 | 2]) + length + bytes([left]) + data


def onnx_file(size: int, filler: int = 0) -> bytes:
    """An ONNX file of `size` bytes, from 20,000 to 2,000,000: one node, one output and an initializer that fills it."""
    rest = 28  # of tags, lengths and the other fields
    graph = _field(1, b"node") + _field(5, bytes([filler]) * (size - rest)) + _field(12, b"output")
    content = b"\x08\x08" + _field(7, graph) + _field(8, b"\x10\x11")
    assert len(content) == size
    return content


CONTENT = onnx_file(1_024_000)


@dataclass
class Site:
    """What the server sends."""

    content: bytes
    etag: str | None = '"one"'
    breaks_after: int | None = None
    ranges: bool = True
    redirect: str | None = None
    content_type: str | None = None
    headers: dict[str, str | None] = field(default_factory=dict)
    """In place of the usual ones; None leaves one out."""
    status: int | None = None
    port: int = 0
    requests: list[tuple[str, str | None]] = field(default_factory=list)
    sent: int = 0

    def answer(self, handler: BaseHTTPRequestHandler) -> None:
        wanted = handler.headers.get("Range")
        self.requests.append((handler.path, wanted))
        if "gone" in handler.path:
            handler.send_error(404)
            return
        if self.redirect and "moved" not in handler.path:
            handler.send_response(302)
            handler.send_header("Location", self.redirect)
            handler.end_headers()
            return
        start = int(wanted[6:-1]) if wanted and self.ranges else 0
        if wanted and handler.headers.get("If-Range", self.etag) != self.etag:
            start = 0
        if start >= len(self.content):
            handler.send_error(416)
            return
        body = self.content[start:]
        headers: dict[str, str | None] = {"Content-Length": str(len(body)), "ETag": self.etag}
        if start:
            headers["Content-Range"] = f"bytes {start}-{len(self.content) - 1}/{len(self.content)}"
        handler.send_response(self.status or (206 if start else 200))
        for name, value in {**headers, "Content-Type": self.content_type, **self.headers}.items():
            if value is not None:
                handler.send_header(name, value)
        handler.end_headers()
        with contextlib.suppress(OSError):  # the client may stop reading
            for place in range(0, len(body[: self.breaks_after]), 1 << 16):
                piece = body[: self.breaks_after][place : place + (1 << 16)]
                handler.wfile.write(piece)
                self.sent += len(piece)


class _QuietServer(ThreadingHTTPServer):
    def handle_error(self, request: object, client_address: object) -> None:
        """Do not print: a client that refuses the certificate ends the connection."""


@contextlib.contextmanager
def _running(handler: type[BaseHTTPRequestHandler], context: ssl.SSLContext | None) -> Iterator[int]:
    class Handler(handler):  # type: ignore[valid-type, misc]
        timeout = 10

        def setup(self) -> None:
            if context is not None:
                self.request = context.wrap_socket(self.request, server_side=True)
            super().setup()

        def finish(self) -> None:
            super().finish()
            with contextlib.suppress(OSError):
                self.request.close()

        def log_message(self, format: str, *arguments: object) -> None:
            pass

    server = _QuietServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@contextlib.contextmanager
def running_site(content: bytes, *, tls: bool = True) -> Iterator[Site]:
    """Serve `content` until the block ends."""
    site = Site(content)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            site.answer(self)

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(CERTIFICATE)
    with _running(Handler, context if tls else None) as site.port:
        yield site


@dataclass
class Proxy:
    """A proxy that leads every connection to one port of this computer."""

    target: int
    port: int = 0
    asked_for: list[str] = field(default_factory=list)


@contextlib.contextmanager
def running_proxy(target: int) -> Iterator[Proxy]:
    """Run a proxy for https until the block ends."""
    proxy = Proxy(target)

    class Handler(BaseHTTPRequestHandler):
        def do_CONNECT(self) -> None:
            proxy.asked_for.append(self.path)
            with socket.create_connection(("127.0.0.1", proxy.target), timeout=10) as far:
                self.send_response(200)
                self.end_headers()
                ends = {self.connection: far, far: self.connection}
                while True:
                    readable = select.select(list(ends), [], [], 10)[0]
                    for end in readable:
                        data = end.recv(1 << 16)
                        if not data:
                            return
                        ends[end].sendall(data)

    with _running(Handler, None) as proxy.port:
        yield proxy


def add_model(
    monkeypatch: pytest.MonkeyPatch, site: Site, *, known: bool, host: str = "", path: str = "rev/large.onnx"
) -> ModelFile:
    """Add `CONTENT`, served by `site`, to the catalogue as ``large``; its size and hash are `known` or not."""
    digest = hashlib.sha256(CONTENT).hexdigest() if known else None
    source = f"https://{host or f'127.0.0.1:{site.port}'}/{path}"
    size = len(CONTENT) if known else None
    model = ModelFile("large", source, "large.onnx", "MIT", "anyone", "", size, digest, True, 1_000_000)
    monkeypatch.setitem(CATALOGUE, "large", model)
    return model
