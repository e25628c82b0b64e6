"""The page in Chromium with software WebGL: time until it can be used, time until a scene is seen, its likeness."""

from __future__ import annotations

import gzip
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Browser, Page, expect, sync_playwright

from engine.core.errors import EnvironmentProblem
from engine.scene import Camera, focal_and_center, read_camera_set

from ..pictures import psnr, read_picture, rendered_by_engine
from .server import ROOT, Row

PAGE = ROOT / "engine" / "serve" / "page" / "dist"
WEBGL = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
SIZE = {"width": 1280, "height": 900}
PROJECT = "0" * 12
N_OPENINGS, N_VIEWS = 5, 8
LONGEST_MS = 120_000


@contextmanager
def serving(folder: Path, *more: str) -> Iterator[str]:
    """Run the server with the data in `folder` and `more` arguments, and yield its address on this computer."""
    with started_server(folder, *more) as said:
        found = re.search(r"(https?)://[^ /]+:(\d+)/", next(said))
        assert found is not None
        yield f"{found[1]}://127.0.0.1:{found[2]}/"


@contextmanager
def started_server(folder: Path, *more: str) -> Iterator[Iterator[str]]:
    """Run the server with the data in `folder` and `more` arguments, and yield the lines that it says."""
    command = [sys.executable, "-m", "engine", "serve", "--events", f"--data={folder}", "--port=0", *more]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stdout is not None
    try:
        yield iter(process.stdout)
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start Chromium without a window, with WebGL in software."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        raise EnvironmentProblem("Chromium is missing. Install it (Debian: apt-get install chromium).")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=WEBGL)
        try:
            yield browser
        finally:
            browser.close()


def page_rows(project: Path) -> list[Row]:
    """Measure the page with a copy of the project folder `project`, and return the rows of the table."""
    sizes = {file.name: len(gzip.compress(file.read_bytes())) for file in PAGE.iterdir()}
    with tempfile.TemporaryDirectory() as name, chromium() as browser:
        copied = Path(name) / "users" / "local" / "projects" / PROJECT
        shutil.copytree(project, copied / "project")
        (copied / "photos").mkdir()
        (copied / "info.json").write_text(json.dumps({"title": "Room", "created": "2026-01-01T00:00:00+00:00"}))
        with serving(Path(name)) as address:
            usable = [seconds_to_use(browser, address) for _ in range(N_OPENINGS)]
            views = [seconds_to_see(browser, address) for _ in range(N_OPENINGS)]
            n_gaussians, likeness = compared(browser, address, copied / "project")
    small = sum(size for file, size in sizes.items() if file not in ("viewer.js", "licences.txt"))
    first, later = f"{views[0]:.1f} s", f"{np.median(views[1:]):.1f} s"
    return [
        ("size with gzip, without the viewer", f"{small / 1e3:.0f} KB", "150 KB"),
        ("size of the viewer with gzip", f"{sizes['viewer.js'] / 1e3:.0f} KB", ""),
        (f"from the address to a page that can be used, median of {N_OPENINGS}", f"{np.median(usable):.2f} s", "1 s"),
        (f"from the address to {n_gaussians:,} Gaussians seen, the first time (exported)", first, "5 s"),
        ("the same later, median", later, "5 s"),
        (
            f"viewer beside the engine's picture, {len(likeness)} photos' cameras: mean and lowest PSNR",
            f"{np.mean(likeness):.1f} dB, {min(likeness):.1f} dB",
            "28 dB",
        ),
    ]


def seconds_to_use(browser: Browser, address: str) -> float:
    """Return the time until the first button of a new browser can be pressed."""
    with browser.new_context(viewport=SIZE) as context:  # type: ignore[arg-type]
        page = context.new_page()
        begin = time.monotonic()
        page.goto(address)
        page.get_by_role("button", name="New project").wait_for()
        return time.monotonic() - begin


def seconds_to_see(browser: Browser, address: str) -> float:
    """Return the time until a new browser shows the scene."""
    with browser.new_context(viewport=SIZE) as context:  # type: ignore[arg-type]
        begin = time.monotonic()
        open_scene(context.new_page(), address)
        return time.monotonic() - begin


def open_scene(page: Page, address: str) -> None:
    """Go to the project, and wait until the viewer has drawn its scene."""
    page.goto(f"{address}#/projects/{PROJECT}")
    expect(page.locator(".canvas-box[data-ready]")).to_be_visible(timeout=LONGEST_MS)
    expect(page.locator(".loading")).to_be_hidden(timeout=LONGEST_MS)


def compared(browser: Browser, address: str, project: Path) -> tuple[int, list[float]]:
    """Return the number of Gaussians, and the PSNR of the viewer's pictures beside the engine's."""
    cameras = read_camera_set(project / "cameras").cameras
    chosen = [cameras[index] for index in np.linspace(0, len(cameras) - 1, N_VIEWS).astype(int)]
    found_psnr = []
    with browser.new_context(viewport=SIZE) as context, tempfile.TemporaryDirectory() as name:  # type: ignore[arg-type]
        page = context.new_page()
        open_scene(page, address)
        facts = page.locator(".facts").inner_text()
        for camera in chosen:
            page.get_by_role("button", name=f"Look from {camera.photo}").click()
            with page.expect_download() as begun:
                page.get_by_role("button", name="Save picture").click()
            file = Path(name) / "viewer.png"
            begun.value.save_as(file)
            shown = read_picture(file)
            expected = engine_picture(project, camera, shown.shape[1], shown.shape[0], Path(name))
            found_psnr.append(psnr(shown, expected))
    found = re.search(r"([\d,.\s]+) Gaussians", facts)
    assert found is not None
    return int(re.sub(r"\D", "", found[1])), found_psnr


def engine_picture(project: Path, camera: Camera, width: int, height: int, folder: Path) -> NDArray[np.float64]:
    """Return what the engine renders for the viewer's camera: the whole photo in the middle of the canvas.

    Parameters
    ----------
    project : Path
    camera : Camera
        Its lens without distortion is used.
    width, height : int
        Size of the canvas.
    folder : Path
        For temporary files.

    Returns
    -------
    array of shape [H, W, 3], float64
        sRGB in [0, 1].
    """
    fx, fy, cx, cy = focal_and_center(camera)
    scale = min(width / camera.width, height / camera.height)
    values = {
        "width": width,
        "height": height,
        "fx": fx * scale,
        "fy": fy * scale,
        "cx": width / 2 + (cx - camera.width / 2) * scale,
        "cy": height / 2 + (cy - camera.height / 2) * scale,
        "viewmat": np.asarray(camera.viewmat).tolist(),
    }
    return rendered_by_engine(project, values, folder)
