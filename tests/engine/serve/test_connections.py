"""Silent, slow and stale connections keep nobody else waiting; the server runs as a program."""

from __future__ import annotations

import http.client
import json
import socket
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from engine.serve.connections import Connections
from engine.serve.settings import ServeSettings

from .conftest import API, jpeg
from .test_resuming import encoded

Start = Callable[..., tuple[subprocess.Popen[str], str]]
SECONDS = 60.0
"""Guards against hanging: a test that needs it has failed."""


class Browser:
    """Requests to a server, each by a connection of its own."""

    def __init__(self, address: str) -> None:
        host, _, port = address.rstrip("/").rpartition("/")[2].partition(":")
        self.place = (host, int(port))
        self.headers: dict[str, str] = {}
        answer, body = self.ask("GET", f"{API}/session")
        self.headers = {
            "Cookie": answer.headers["set-cookie"].partition(";")[0],
            "X-CSRF-Token": json.loads(body)["csrf"],
        }

    def ask(self, method: str, path: str, body: bytes | None = None, **headers: str) -> tuple[Any, bytes]:
        connection = http.client.HTTPConnection(*self.place, timeout=SECONDS)
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request(method, path, body, {**self.headers, **named})
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        return answer, content

    def begin(self, size: int) -> str:
        _, body = self.ask("POST", f"{API}/projects", b'{"title": "Room"}', Content_Type="application/json")
        project = json.loads(body)["id"]
        metadata = f"project {encoded(project)},filename {encoded('vase.jpg')}"
        answer, _ = self.ask(
            "POST", f"{API}/uploads/", Upload_Length=str(size), Upload_Metadata=metadata, Tus_Resumable="1.0.0"
        )
        return str(answer.headers["location"])

    def hanging_patch(self, location: str, offset: int, size: int, first: bytes) -> socket.socket:
        """Send the beginning of a part, and then nothing."""
        stale = socket.create_connection(self.place, SECONDS)
        lines = [f"PATCH {location} HTTP/1.1", "Host: 127.0.0.1", f"Content-Length: {size}"]
        lines += [f"Upload-Offset: {offset}", "Content-Type: application/offset+octet-stream", "Tus-Resumable: 1.0.0"]
        lines += [f"{name}: {value}" for name, value in self.headers.items()]
        stale.sendall("\r\n".join([*lines, "", ""]).encode() + first)
        return stale

    def patch(self, location: str, offset: int, content: bytes) -> int:
        """Continue an upload as the protocol says: an answer of 409 names the byte at which it goes on.

        A request on another connection, sent before this one, may reach the server after it.
        """
        for _ in range(10):
            part = {"Content_Type": "application/offset+octet-stream", "Upload_Offset": str(offset)}
            answer, _ = self.ask("PATCH", location, content[offset:], Tus_Resumable="1.0.0", **part)
            if answer.status != 409:
                break
            offset = int(answer.headers["upload-offset"])
        return int(answer.status)


@pytest.fixture
def sockets() -> Iterator[list[socket.socket]]:
    found: list[socket.socket] = []
    yield found
    for one in found:
        one.close()


def test_hanging_upload_is_ended_by_the_one_that_continues_it(start: Start, sockets: list[socket.socket]) -> None:
    browser, content = Browser(start()[1]), jpeg()
    location = browser.begin(len(content))
    sockets.append(browser.hanging_patch(location, 0, len(content), content[:500]))
    answer, _ = browser.ask("HEAD", location, Tus_Resumable="1.0.0")
    offset = int(answer.headers["upload-offset"])
    sockets.append(browser.hanging_patch(location, offset, len(content) - offset, b""))
    assert browser.ask("GET", f"{API}/projects")[0].status == 200
    assert browser.patch(location, offset, content) == 204


def test_silent_and_half_sent_connections_keep_nobody_out(start: Start, sockets: list[socket.socket]) -> None:
    process, address = start()
    browser = Browser(address)
    for number in range(700):
        silent = socket.create_connection(browser.place, SECONDS)
        sockets.append(silent)
        if number % 3 == 1:
            silent.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ")
        elif number % 3 == 2:
            silent.sendall(b"POST /api/v1/session HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 50\r\n\r\n{")
    assert browser.ask("GET", f"{API}/projects")[0].status == 200
    assert len(list(Path(f"/proc/{process.pid}/fd").iterdir())) < 500 if Path("/proc/self/fd").exists() else True


def test_connection_without_a_request_is_closed(start: Start, tmp_path: Path, sockets: list[socket.socket]) -> None:
    browser = Browser(start(quick=True)[1])
    for first in (b"", b"GET / HTTP/1.1\r\nHost: ", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"):
        silent = socket.create_connection(browser.place, SECONDS)
        sockets.append(silent)
        silent.sendall(first)
        while silent.recv(65536):
            pass


def test_address_of_the_client_is_that_of_its_connection(start: Start) -> None:
    browser = Browser(start()[1])
    headers = {"X_Forwarded_Proto": "https", "X_Forwarded_Host": "evil.example", "X_Forwarded_For": "10.0.0.1"}
    _, body = browser.ask("POST", f"{API}/projects", b'{"title": "Room"}', Content_Type="application/json")
    metadata = f"project {encoded(json.loads(body)['id'])},filename {encoded('a.jpg')}"
    answer, _ = browser.ask(
        "POST", f"{API}/uploads/", Upload_Length="9", Upload_Metadata=metadata, Tus_Resumable="1.0.0", **headers
    )
    assert answer.headers["location"].startswith("/api/v1/uploads/")


class _Socket:
    def __init__(self, address: str, port: int) -> None:
        self.peer = (address, port)
        self.is_ended = False

    def shutdown(self, _: int) -> None:
        self.is_ended = True


def test_room_is_made_by_whoever_has_the_most_connections_without_a_request(tmp_path: Path) -> None:
    import asyncio

    async def admit() -> None:
        connections = Connections(ServeSettings(tmp_path, max_connections=6, max_address_connections=4))
        flood: list[Any] = [_Socket("10.0.0.1", port) for port in range(10)]
        assert all(connections.admit(one) for one in flood)
        assert [one.is_ended for one in flood] == [True] * 6 + [False] * 4
        for one in flood[6:8]:
            connections.works(one.peer)
        others: list[Any] = [_Socket(f"10.0.1.{number}", 1) for number in range(4)]
        assert all(connections.admit(one) for one in others)
        assert not any(one.is_ended for one in (*flood[6:8], *others)) and all(one.is_ended for one in flood[8:])
        for one in others:
            connections.works(one.peer)
        # Now all have a request.
        late: Any = _Socket("10.0.2.1", 1)
        assert not connections.admit(late)
        connections.closed(flood[6])
        assert connections.admit(late)

    asyncio.run(admit())
