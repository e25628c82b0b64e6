"""The page's own client continues uploads: after a lost connection, a reload and a restart of the server."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from tests.conftest import wait_until

from .conftest import PLACES, ROOT, new_project

SLOW = 300_000
"""Bytes per second of the browser, so that it can be interrupted."""


class Program:
    """A server that can be killed and started again at the same address."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.port = folder, 0
        self.start()

    def start(self) -> None:
        words = ["serve", "--events", f"--data={self.folder}", f"--port={self.port}"]
        command = [sys.executable, "-m", "engine", *words]
        self.process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, start_new_session=True)
        assert self.process.stdout is not None
        found = re.search(r"http://[^ ]+:(\d+)/", self.process.stdout.readline())
        assert found is not None
        self.address, self.port = found[0], int(found[1])

    def kill(self) -> None:
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.communicate()

    def pieces(self) -> list[int]:
        """Return the sizes of the unfinished uploads."""
        folder = self.folder / "users" / "local" / "uploads"
        return [file.stat().st_size for file in folder.glob("*") if not file.suffix] if folder.is_dir() else []

    def photos(self) -> list[bytes]:
        return [file.read_bytes() for file in self.folder.glob("users/local/projects/*/photos/*")]


@pytest.fixture
def program(tmp_path: Path) -> Iterator[Program]:
    started = Program(tmp_path / "data")
    yield started
    started.kill()


def large_photo(folder: Path) -> Path:
    """Return a photo of 9 MB, whose first part of 8 MiB is not its last."""
    folder.mkdir()
    file = folder / "image.jpg"
    pixels = np.random.default_rng(0).integers(0, 255, (2000, 2400, 3), np.uint8)
    Image.fromarray(pixels).save(file, "JPEG", quality=95)
    return file


@pytest.mark.web
@pytest.mark.parametrize("how", ["lost connection", "reload", "restart"])
def test_upload_goes_on_where_it_stopped(browser: Browser, program: Program, tmp_path: Path, how: str) -> None:
    photo = large_photo(tmp_path / "photos")
    width, height = PLACES["phone"]
    with browser.new_context(viewport={"width": width, "height": height}) as context:
        page = context.new_page()
        starts: list[str] = []
        page.on("request", lambda request: starts.append(request.url) if is_start(request) else None)
        page.goto(program.address)
        new_project(page, "Room")
        slow(page, SLOW)
        choose(page, photo)
        wait_until(lambda: any(size > 500_000 for size in program.pieces()))
        interrupt(page, program, how)
        before = max(program.pieces())
        assert before >= 500_000
        if how == "reload":
            choose(page, photo)
        slow(page, -1)
        wait_until(lambda: program.photos() == [photo.read_bytes()])
        expect(page.get_by_role("list", name="Photos").get_by_role("listitem")).to_have_count(1, timeout=60_000)
        # It was begun once.
        assert len(starts) == 1 and program.pieces() == []


def is_start(request: object) -> bool:
    return request.method == "POST" and request.url.endswith("/uploads/")  # type: ignore[attr-defined]


def choose(page: Page, photo: Path) -> None:
    page.locator("input[type=file]").first.set_input_files([str(photo)])


def slow(page: Page, rate: int, offline: bool = False) -> None:
    """Limit what the browser sends to `rate` bytes per second; -1: no limit."""
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    session.send(
        "Network.emulateNetworkConditions",
        {"offline": offline, "latency": 0, "downloadThroughput": -1, "uploadThroughput": rate},
    )


def interrupt(page: Page, program: Program, how: str) -> None:
    if how == "lost connection":
        slow(page, -1, offline=True)
    elif how == "reload":
        page.once("dialog", lambda dialog: dialog.accept())
        page.reload()
        expect(page.get_by_role("heading", name="Room")).to_be_visible()
    else:
        program.kill()
        program.start()


@pytest.mark.web
def test_photos_of_a_phone_that_share_a_name_are_all_there(browser: Browser, program: Program, tmp_path: Path) -> None:
    photos = []
    for seed in range(12):
        folder = tmp_path / str(seed)
        folder.mkdir()
        pixels = np.random.default_rng(seed).integers(0, 255, (60, 90, 3), np.uint8)
        Image.fromarray(pixels).save(folder / "image.jpg", "JPEG")
        photos.append({"name": "image.jpg", "mimeType": "image/jpeg", "buffer": (folder / "image.jpg").read_bytes()})
    with browser.new_context() as context:
        page = context.new_page()
        page.goto(program.address)
        new_project(page, "Room")
        page.locator("input[type=file]").first.set_input_files(photos)  # type: ignore[arg-type]
        wait_until(lambda: len(program.photos()) == 12)
    assert sorted(program.photos()) == sorted(photo["buffer"] for photo in photos)
