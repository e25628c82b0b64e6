"""Cost of the server, which runs as a program: start, uploads over loopback, memory, events."""

from __future__ import annotations

import base64
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from ..places import ROOT
from ..processes import cpu_of
from .breaking import measure_breaking, measure_silence

Row = tuple[str, str, str]
"""What was measured, the figure, and the goal."""
N_STARTS, N_CLIENTS, N_EVENTS = 5, 32, 60
UPLOAD_BYTES, CHUNK = 512 << 20, 8 << 20
WATCH_SECONDS = 20.0
ENGINE = """
import json, sys, time
for number in range({n}):
    print(json.dumps({{"v": 1, "kind": "progress", "time": time.time(), "stage": "training", "fraction": number / {n},
                      "seconds_left": None, "message": str(time.time())}}), flush=True)
    time.sleep({pause})
print(json.dumps({{"v": 1, "kind": "finished", "time": time.time(), "message": "", "outputs": {{}}}}), flush=True)
"""
PROGRAM = """
import functools, sys
from pathlib import Path
from engine.serve import job_queue
job_queue.engine_environment = functools.partial(job_queue.engine_environment, root=Path(sys.argv[1]))
from engine.cli.main import main
sys.exit(main(sys.argv[2:]))
"""


class Server:
    """A server with an engine that only writes events."""

    def __init__(self, folder: Path) -> None:
        engine = folder / "root" / "engine"
        engine.mkdir(parents=True, exist_ok=True)
        (engine / "__init__.py").touch()
        pause = WATCH_SECONDS / N_EVENTS
        (engine / "__main__.py").write_text(ENGINE.format(n=N_EVENTS, pause=pause))
        words = ["serve", "--events", f"--data={folder / 'data'}", "--port=0"]
        begin = time.monotonic()
        self.process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(engine.parent), *words], cwd=ROOT, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        found = re.search(r"http://[^ ]+/", self.process.stdout.readline())
        assert found is not None
        self.start_seconds = time.monotonic() - begin
        self.http = httpx.Client(base_url=f"{found[0]}api/v1", timeout=60)
        self.http.headers["X-CSRF-Token"] = self.http.get("/session").json()["csrf"]

    def cpu_seconds(self) -> float:
        """Return the CPU time of the server itself, without the engine's."""
        return cpu_of(self.process.pid)

    def memory(self) -> int:
        """Return the resident bytes of the server."""
        return int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    def stop(self) -> None:
        """End it."""
        self.http.close()
        self.process.kill()
        self.process.communicate()


def measure_upload(server: Server, project: str) -> tuple[float, float]:
    """Return bytes per second and the largest memory while a video of random bytes is uploaded."""
    words = {"project": project, "filename": "walk.mp4", "filetype": "video/mp4"}
    metadata = ",".join(f"{key} {base64.b64encode(value.encode()).decode()}" for key, value in words.items())
    headers = {"Tus-Resumable": "1.0.0", "Upload-Length": str(UPLOAD_BYTES), "Upload-Metadata": metadata}
    # Joined as browsers do; the client would put the path of the API before it a second time.
    location = server.http.base_url.join(server.http.post("/uploads/", headers=headers).headers["location"])
    chunk = np.random.default_rng(0).bytes(CHUNK)
    begin, peak = time.monotonic(), 0
    # The last chunk is left out: what follows it, taking photos from the video, is the engine's work.
    for offset in range(0, UPLOAD_BYTES - CHUNK, CHUNK):
        headers = {"Tus-Resumable": "1.0.0", "Upload-Offset": str(offset)}
        headers["Content-Type"] = "application/offset+octet-stream"
        server.http.patch(location, content=chunk, headers=headers).raise_for_status()
        peak = max(peak, server.memory())
    return (UPLOAD_BYTES - CHUNK) / (time.monotonic() - begin), peak


def measure_events(server: Server, project: str, folder: Path) -> tuple[list[float], float]:
    """Return the delays of events at all clients, and the server's CPU time as a share of one core."""
    photos = folder / "data" / "users" / "local" / "projects" / project / "photos"
    (photos / "a.jpg").touch()
    delays: list[float] = []
    ready = threading.Barrier(N_CLIENTS + 1)

    def watch() -> None:
        with (
            httpx.Client(base_url=server.http.base_url, cookies=server.http.cookies, timeout=60) as client,
            client.stream("GET", f"/projects/{project}/events") as stream,
        ):
            ready.wait()
            for line in stream.iter_lines():
                data: Any = json.loads(line[5:]) if line.startswith("data: {") else None
                if data and data.get("message"):
                    delays.append(time.time() - float(data["message"]))
                if data and data.get("state") == "finished":
                    return

    watchers = [threading.Thread(target=watch) for _ in range(N_CLIENTS)]
    for watcher in watchers:
        watcher.start()
    ready.wait()
    before, begin = server.cpu_seconds(), time.monotonic()
    server.http.post(f"/projects/{project}/jobs", json={"kind": "reconstruct"}).raise_for_status()
    for watcher in watchers:
        watcher.join()
    return delays, (server.cpu_seconds() - before) / (time.monotonic() - begin)


def server_rows() -> list[Row]:
    """Measure, and return the rows of the table."""
    starts = []
    for _ in range(N_STARTS):
        with tempfile.TemporaryDirectory() as name:
            server = Server(Path(name))
            starts.append(server.start_seconds)
            server.stop()
    with tempfile.TemporaryDirectory() as name:
        server = Server(Path(name))
        project = server.http.post("/projects", json={"title": "Room"}).json()["id"]
        speed, memory = measure_upload(server, project)
        delays, share = measure_events(server, project, Path(name))
        silence, n_silent = measure_silence(server)
        broken = server.http.post("/projects", json={"title": "Broken"}).json()["id"]
        found = measure_breaking(server, broken, Path(name))
        server.stop()
    size, part = UPLOAD_BYTES >> 20, CHUNK >> 20
    late = f"{np.median(delays):.2f} s, {np.quantile(delays, 0.99):.2f} s"
    rate = N_EVENTS / WATCH_SECONDS
    return [
        (f"start until the page is served, median of {N_STARTS}", f"{np.median(starts):.2f} s", "1.5 s"),
        (f"upload of {size} MiB over loopback, in parts of {part} MiB", f"{speed / 1e6:.0f} MB/s", "at least 120 MB/s"),
        ("memory of the server meanwhile, at most", f"{memory / 1e6:.0f} MB", "200 MB"),
        (f"event at {N_CLIENTS} clients after the engine wrote it, median and 99 %", late, "1 s"),
        (f"CPU of the server with {N_CLIENTS} clients and {rate:.0f} events a second", f"{share:.1%} of a core", "5 %"),
        (
            f"{found['uploads']:,} photos of 40 clients, all called image.jpg, {found['breaks']:,} breaks: missing",
            f"{found['missing']} of {found['stored']:,} stored", "0",
        ),
        ("slowest answer to another request meanwhile", f"{found['slowest']:.2f} s", "1 s"),
        ("memory of the server meanwhile, at most", f"{found['memory'] / 1e6:.0f} MB", "200 MB"),
        (f"slowest answer to others with {n_silent:,} silent connections", f"{silence:.2f} s", "1 s"),
    ]  # fmt: skip
