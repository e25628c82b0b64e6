"""What a browser does with the server in a container: waits, uploads photos, starts jobs and downloads an object.

A program of its own, so that `container_test.py` can run it in the network of the container. It prints JSON.

example: python client.py --data DATA --port 8765 --token TOKEN upload photos/*.jpg
"""

from __future__ import annotations

import argparse
import base64
import http.client
import json
import ssl
import sys
import time
from pathlib import Path
from typing import Any

API = "/api/v1"
CHUNK = 200_000
"""Bytes of one part of an upload; photos are sent in several, as by a phone that loses its connection."""


class Client:
    """A user with a token. The certificate is verified: it is the one in the data folder."""

    def __init__(self, data: Path, port: int, token: str) -> None:
        self._certificate, self._port = data / "certificate.pem", port
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}

    def send(self, method: str, path: str, body: bytes = b"", **headers: str) -> http.client.HTTPResponse:
        """Send a request and return the answer, whose body is not read."""
        context = ssl.create_default_context(cafile=self._certificate)
        connection = http.client.HTTPSConnection("localhost", self._port, timeout=120, context=context)
        names = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request(method, path, body, {**self._headers, **names})
        return connection.getresponse()

    def ask(self, method: str, path: str, content: object = None) -> Any:
        """Send and receive JSON; an answer that is no success ends the program."""
        body = b"" if content is None else json.dumps(content).encode()
        answer = self.send(method, API + path, body, Content_Type="application/json")
        text = answer.read().decode()
        if answer.status >= 300:
            sys.exit(f"{method} {path}: {answer.status} {text}")
        return json.loads(text) if text else None

    def wait_for_server(self, seconds: float) -> None:
        """Wait until the server answers."""
        deadline = time.monotonic() + seconds
        while True:
            try:
                if self.send("GET", f"{API}/session").status == 200:
                    return
            except OSError as error:
                if time.monotonic() > deadline:
                    sys.exit(f"The server does not answer: {error}")
            time.sleep(0.02)

    def upload(self, photos: list[Path]) -> str:
        """Make a project, upload photos by the tus protocol, and return the name of the project."""
        project: str = self.ask("POST", "/projects", {"title": "Museum room"})["id"]
        for photo in photos:
            content = photo.read_bytes()
            words = {"project": project, "filename": photo.name, "filetype": "image/jpeg"}
            metadata = ",".join(f"{key} {base64.b64encode(value.encode()).decode()}" for key, value in words.items())
            begun = self.send(
                "POST", f"{API}/uploads/", Tus_Resumable="1.0.0", Upload_Length=str(len(content)),
                Upload_Metadata=metadata,
            )  # fmt: skip
            location = begun.headers["location"] or sys.exit(f"{photo.name}: {begun.status} {begun.read().decode()}")
            path = "/" + location.split("/", 3)[3]
            for offset in range(0, len(content), CHUNK):
                done = self.send(
                    "PATCH", path, content[offset : offset + CHUNK], Tus_Resumable="1.0.0",
                    Upload_Offset=str(offset), Content_Type="application/offset+octet-stream",
                )  # fmt: skip
                if done.status != 204:
                    sys.exit(f"{photo.name}: {done.status} {done.read().decode()}")
        return project

    def wait_for_job(self, project: str, stage: str, fraction: float, seconds: float) -> dict[str, Any]:
        """Wait until the job has ended well, or has come to a fraction of a stage, and return it."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            found: dict[str, Any] = self.ask("GET", f"/projects/{project}")
            job = found["job"]
            if job and not found["waiting"]:
                if job["state"] == "stopped":
                    sys.exit(f"The job stopped: {job['error']}")
                if job["state"] == "finished" or (stage and job["stage"] == stage and job["fraction"] >= fraction):
                    return {"job": job, "objects": found["objects"]}
            time.sleep(0.2)
        sys.exit(f"Not done within {seconds:.0f} s: {found['job']} {found['waiting']}")

    def download(self, project: str, object_id: str, out: Path) -> int:
        """Download an object as GLB and return its size."""
        answer = self.send("GET", f"{API}/projects/{project}/objects/{object_id}/export?format=glb")
        content = answer.read()
        if answer.status != 200:
            sys.exit(f"{answer.status} {content.decode(errors='replace')}")
        out.write_bytes(content)
        return len(content)


def main() -> int:
    """Run one command and return 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--token", default="")
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("wait-for-server")
    commands.add_parser("upload").add_argument("photos", type=Path, nargs="+")
    start = commands.add_parser("start")
    start.add_argument("project")
    start.add_argument("job", type=json.loads)
    wait = commands.add_parser("wait-for-job")
    wait.add_argument("project")
    wait.add_argument("--stage", default="")
    wait.add_argument("--fraction", type=float, default=0.0)
    download = commands.add_parser("download")
    for name in ("project", "object_id"):
        download.add_argument(name)
    download.add_argument("out", type=Path)
    options = parser.parse_args()
    client = Client(options.data, options.port, options.token)
    answer: object = None
    if options.command == "wait-for-server":
        client.wait_for_server(60)
    elif options.command == "upload":
        answer = client.upload(options.photos)
    elif options.command == "start":
        answer = client.ask("POST", f"/projects/{options.project}/jobs", options.job)
    elif options.command == "wait-for-job":
        answer = client.wait_for_job(options.project, options.stage, options.fraction, 1500)
    else:
        answer = client.download(options.project, options.object_id, options.out)
    print(json.dumps(answer))
    return 0


if __name__ == "__main__":
    sys.exit(main())
