"""A server with an engine that only writes events and files, and a client that uploads by the tus protocol."""

from __future__ import annotations

import base64
import re
import shutil
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from PIL import Image

from engine.core.engine_process import engine_environment
from engine.serve import ServeSettings, job_queue
from engine.serve.app import create_app
from tests.conftest import PATIENCE, ROOT
from tests.engine.objects.fakes import trained_project
from tests.engine.pictures.blob_scene import BlobScene, make_scene

API = "/api/v1"
FAKE_ENGINE = """
import json, pathlib, sys, time

def say(kind, **fields):
    print(json.dumps({"v": 1, "kind": kind, "time": time.time(), **fields}), flush=True)

words = sys.argv[1:]
project = next((pathlib.Path(w[6:]) for w in words if w.startswith("--out=")), pathlib.Path(words[1]))
project.mkdir(exist_ok=True)
(project / "words.json").write_text(json.dumps(words))
with (project / "runs.txt").open("a") as runs:
    runs.write(words[0] + "\\n")
say("stage_started", stage="training")
say("progress", stage="training", fraction=0.5, seconds_left=3.0, message="")
say("metric", stage="training", name="psnr", value=21.5, step=10, seconds=1.5)
"""

PROGRAM = """
import sys
from pathlib import Path
from engine.serve import run
run.PAGE = Path(sys.argv[1])
from engine.serve import app
app.create_app.__defaults__ = (Path(sys.argv[1]),)
from engine.cli.main import main
sys.exit(main(sys.argv[2:]))
"""

QUICK = """
from engine.serve import ServeSettings
ServeSettings.header_seconds = 0.2
ServeSettings.__init__.__defaults__ = tuple(
    0.2 if name == "header_seconds" else value
    for name, value in zip(list(ServeSettings.__dataclass_fields__)[1:], ServeSettings.__init__.__defaults__)
)
"""
"""A server that gives a request hardly any time."""


@dataclass
class Client:
    """What a browser does, with one signed-in user."""

    http: TestClient
    data: Path
    is_running: bool = True

    def stop(self) -> None:
        """End the server."""
        if self.is_running:
            self.http.__exit__(None, None, None)
        self.is_running = False

    def new_project(self, title: str = "Room") -> str:
        project: str = self.http.post(f"{API}/projects", json={"title": title}).json()["id"]
        return project

    def upload(self, project: str, name: str, content: bytes, **headers: str) -> Any:
        """Upload a file in one part, and return the last answer."""
        begun = self.begin(project, name, len(content), **headers)
        return begun if begun.status_code != 201 else self.send(begun.headers["location"], content)

    def begin(self, project: str, name: str, size: int, **headers: str) -> Any:
        words = {"project": project, "filename": name, "filetype": "image/jpeg"}
        metadata = ",".join(f"{key} {base64.b64encode(value.encode()).decode()}" for key, value in words.items())
        headers = {"Tus-Resumable": "1.0.0", "Upload-Length": str(size), "Upload-Metadata": metadata, **headers}
        return self.http.post(f"{API}/uploads/", headers=headers)

    def send(self, location: str, content: bytes, offset: int = 0) -> Any:
        headers = {"Tus-Resumable": "1.0.0", "Upload-Offset": str(offset)}
        headers["Content-Type"] = "application/offset+octet-stream"
        return self.http.patch(location, content=content, headers=headers)

    def wait_for_job(self, project: str, state: str) -> dict[str, Any]:
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            found = self.http.get(f"{API}/projects/{project}").json()
            if found["job"] is not None and found["job"]["state"] == state and not found["waiting"]:
                job: dict[str, Any] = found["job"]
                return job
            time.sleep(0.05)
        raise AssertionError(found)

    def folder(self, project: str, user: str = "local") -> Path:
        return self.data / "users" / user / "projects" / project


def jpeg(seed: int = 0, side: int = 64) -> bytes:
    """Return the bytes of a photo; another one for each seed."""
    import io

    stream = io.BytesIO()
    pixels = np.random.default_rng(seed).integers(0, 255, (side, side * 3 // 2, 3), np.uint8)
    Image.fromarray(pixels).save(stream, "JPEG")
    return stream.getvalue()


@pytest.fixture
def page(tmp_path: Path) -> Path:
    folder = tmp_path / "page"
    folder.mkdir()
    (folder / "index.html").write_text("<!doctype html><title>Gaussian Heritage</title>")
    return folder


@pytest.fixture
def fake_engine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Return a function that replaces the engine by a script, which ends the common beginning."""
    folder = tmp_path / "engine root" / "engine"
    folder.mkdir(parents=True)
    (folder / "__init__.py").touch()

    def make(end: str) -> None:
        (folder / "__main__.py").write_text(FAKE_ENGINE + textwrap.dedent(end))

    make("say('finished', message='done', outputs={})")
    monkeypatch.setattr(job_queue, "engine_environment", lambda: engine_environment(root=folder.parent))
    return make


@pytest.fixture
def make_client(tmp_path: Path, page: Path, fake_engine: Callable[[str], None]) -> Iterator[Callable[..., Client]]:
    """Return a function that starts a server with settings, signed in where no token is needed."""
    open_clients: list[Client] = []

    def make(**settings: Any) -> Client:
        data = tmp_path / "data"
        given = {"data": data, "min_free_bytes": 0, **settings}
        http = TestClient(create_app(ServeSettings(**given), ["testserver"], page), raise_server_exceptions=False)
        http.__enter__()
        http.headers["X-CSRF-Token"] = http.get(f"{API}/session").json()["csrf"]
        open_clients.append(Client(http, data))
        return open_clients[-1]

    yield make
    for client in open_clients:
        client.stop()


@pytest.fixture
def client(make_client: Callable[..., Client]) -> Client:
    return make_client()


@pytest.fixture
def start(page: Path, tmp_path: Path) -> Iterator[Callable[..., tuple[subprocess.Popen[str], str]]]:
    """Return a function that starts a server with options, and returns its process and address."""
    running: list[subprocess.Popen[str]] = []

    def begin(*options: str, quick: bool = False) -> tuple[subprocess.Popen[str], str]:
        words = ["serve", "--events", f"--data={tmp_path / 'data'}", "--port=0", *options]
        program = (QUICK if quick else "") + PROGRAM
        process = subprocess.Popen(
            [sys.executable, "-c", program, str(page), *words], cwd=ROOT, stdout=subprocess.PIPE, text=True,
            start_new_session=True,
        )  # fmt: skip
        running.append(process)
        assert process.stdout is not None
        said = ""
        while (found := re.search(r"https?://[^ ]+/", said)) is None:
            line = process.stdout.readline()
            assert line, said
            said += line
        (tmp_path / "said.txt").write_text(said)
        return process, found[0]

    yield begin
    for process in running:
        process.kill()
        process.communicate()


@pytest.fixture(scope="session")
def scene() -> BlobScene:
    return make_scene()


@pytest.fixture
def project(client: Client, scene: BlobScene) -> str:
    """A project with a trained scene, without objects."""
    project = client.new_project()
    folder = client.folder(project)
    shutil.rmtree(folder / "photos")
    trained_project(scene, folder)
    return project
