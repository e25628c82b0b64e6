"""Many clients whose uploads break at random moments and go on, and many silent connections: is all there, who waits?

The clients are of the protocol alone: what a browser does after a break, asking for the offset and sending the rest.
"""

from __future__ import annotations

import base64
import hashlib
import http.client
import io
import random
import socket
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

N_CLIENTS, N_UPLOADS, N_SILENT = 40, 1000, 2000
BREAKS = 0.5
"""Share of the parts that break off."""
PART = 64 << 10
SIDE = 400
"""Pixels of the photos of noise, some 200 KB each."""
PAUSE = 0.05
TUS = {"Tus-Resumable": "1.0.0"}


class Prober:
    """Asks for the list of projects again and again, and keeps the longest time until an answer."""

    def __init__(self, place: tuple[str, int], headers: dict[str, str], watch: Callable[[], int]) -> None:
        self._place, self._headers, self._watch = place, headers, watch
        self._end = threading.Event()
        self.slowest, self.peak, self.n_answers = 0.0, 0, 0
        self.problem: Exception | None = None
        self._thread = threading.Thread(target=self._ask)

    def __enter__(self) -> Prober:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()
        if self.problem is not None:
            raise self.problem

    def _ask(self) -> None:
        try:
            self._ask_until_end()
        except (OSError, http.client.HTTPException, AssertionError) as error:
            self.problem = error

    def _ask_until_end(self) -> None:
        while not self._end.wait(PAUSE):
            begin = time.monotonic()
            connection = http.client.HTTPConnection(*self._place, timeout=60)
            connection.request("GET", "/api/v1/projects", headers=self._headers)
            answer = connection.getresponse()
            answer.read()
            connection.close()
            assert answer.status == 200, answer.status
            self.slowest = max(self.slowest, time.monotonic() - begin)
            self.peak = max(self.peak, self._watch())
            self.n_answers += 1


class BreakingClient:
    """Uploads photos, all of one name, and breaks off again and again."""

    def __init__(self, place: tuple[str, int], headers: dict[str, str], project: str, seed: int) -> None:
        self._place, self._headers, self._project = place, headers, project
        self._random = random.Random(seed)
        self.n_breaks = 0

    def upload(self, content: bytes) -> None:
        """Upload a photo, whatever breaks."""
        words = {"project": self._project, "filename": "image.jpg", "sha256": hashlib.sha256(content).hexdigest()}
        metadata = ",".join(f"{key} {base64.b64encode(value.encode()).decode()}" for key, value in words.items())
        answer = self._ask(
            "POST", "/api/v1/uploads/", {"Upload-Length": str(len(content)), "Upload-Metadata": metadata}
        )
        assert answer.status == 201, answer.status
        location = str(answer.headers["location"])
        while True:
            answer = self._ask("HEAD", location, {})
            assert answer.status == 200, answer.status
            offset = int(answer.headers["upload-offset"])
            if offset == len(content) or self._send(location, content, offset):
                return

    def _send(self, location: str, content: bytes, offset: int) -> bool:
        """Send the rest, or break off; return whether it was taken in."""
        headers = {"Upload-Offset": str(offset), "Content-Type": "application/offset+octet-stream"}
        if self._random.random() >= BREAKS:
            answer = self._ask("PATCH", location, headers, content[offset:])
            assert answer.status in (204, 409), answer.status
            # A late request of before a break may have ended this one: the answer says how far it came.
            return answer.status == 204 and int(answer.headers["upload-offset"]) == len(content)
        self.n_breaks += 1
        connection = self._request("PATCH", location, {**headers, "Content-Length": str(len(content) - offset)})
        connection.send(content[offset : offset + self._random.randrange(len(content) - offset + 1)])
        if self._random.random() < 0.5:
            # A phone that loses its network: the connection hangs, and the server is not told.
            threading.Timer(5.0, connection.close).start()
        else:
            connection.close()
        return False

    def _request(self, method: str, path: str, headers: dict[str, str]) -> http.client.HTTPConnection:
        connection = http.client.HTTPConnection(*self._place, timeout=120)
        connection.putrequest(method, path)
        for name, value in {**self._headers, **TUS, **headers}.items():
            connection.putheader(name, value)
        connection.endheaders()
        return connection

    def _ask(self, method: str, path: str, headers: dict[str, str], body: bytes = b"") -> http.client.HTTPResponse:
        length = {} if method == "HEAD" else {"Content-Length": str(len(body))}
        connection = self._request(method, path, {**headers, **length})
        if body:
            connection.send(body)
        answer = connection.getresponse()
        answer.read()
        connection.close()
        return answer


def measure_breaking(server: Any, project: str, folder: Path) -> dict[str, float]:
    """Return how many photos and breaks there were, what is missing, the slowest other answer, and the largest memory.

    Parameters
    ----------
    server : Server
        Of `benchmarks.serve.server`.
    project : str
        An empty project.
    folder : Path
        That of the server.
    """
    place, headers = place_and_headers(server)
    expected: list[str] = []
    lock, breaks = threading.Lock(), [0]

    def work(number: int) -> None:
        client = BreakingClient(place, headers, project, number)
        for seed in range(number, N_UPLOADS, N_CLIENTS):
            content = photo(seed)
            client.upload(content)
            with lock:
                expected.append(hashlib.sha256(content).hexdigest())
        breaks[0] += client.n_breaks

    with Prober(place, headers, server.memory) as prober, ThreadPoolExecutor(N_CLIENTS) as pool:
        begin = time.monotonic()
        list(pool.map(work, range(N_CLIENTS)))
        seconds = time.monotonic() - begin
    photos = folder / "data" / "users" / "local" / "projects" / project / "photos"
    stored = {hashlib.sha256(file.read_bytes()).hexdigest() for file in photos.iterdir()}
    return {
        "uploads": len(expected), "breaks": breaks[0], "missing": len(set(expected) - stored), "stored": len(stored),
        "slowest": prober.slowest, "memory": prober.peak, "seconds": seconds,
    }  # fmt: skip


def measure_silence(server: Any) -> tuple[float, int]:
    """Return the slowest answer to others while many connections are opened that send nothing, and how many of them."""
    place, headers = place_and_headers(server)
    silent = []
    with Prober(place, headers, server.memory) as prober:
        for _ in range(N_SILENT):
            silent.append(socket.create_connection(place, 60))
        before = prober.n_answers
        while prober.n_answers < before + 20 and prober.problem is None:
            time.sleep(PAUSE)
    for one in silent:
        one.close()
    return prober.slowest, len(silent)


def place_and_headers(server: Any) -> tuple[tuple[str, int], dict[str, str]]:
    """Return host and port of a server, and what signs a request in."""
    url = server.http.base_url
    cookie = "; ".join(f"{name}={value}" for name, value in server.http.cookies.items())
    return (url.host, url.port), {"Cookie": cookie, "X-CSRF-Token": server.http.headers["X-CSRF-Token"]}


def photo(seed: int) -> bytes:
    """Return a photo of noise; another one for each seed."""
    stream = io.BytesIO()
    pixels = np.random.default_rng(seed).integers(0, 255, (SIDE, SIDE * 3 // 2, 3), np.uint8)
    Image.fromarray(pixels).save(stream, "JPEG", quality=70)
    return stream.getvalue()
