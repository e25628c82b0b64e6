"""The page in a real browser (Debian's Chromium, software WebGL), served by the real server with the real engine."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Locator, Page, expect, sync_playwright

from benchmarks.serve.page import WEBGL, serving
from tests.conftest import ROOT

PAGE = ROOT / "engine" / "serve" / "page"
PHOTOS = sorted((ROOT / "demo" / "museum_room" / "photos").glob("*.jpg"))[:12]
PLACES = {"desktop": (1280, 900), "phone": (390, 844)}
RUN_MS = 1_800_000
"""Longest time of a reconstruction; with twenty programs for two cores, the first picture took 13 minutes."""
VIEWER_MS = 30_000
PICTURES = os.environ.get("GAUSSIAN_HERITAGE_WEB_PICTURES")
"""Folder of the screenshots that the documentation shows; without it, none are kept."""


def keep_picture(target: Page | Locator, name: str) -> None:
    """Keep a screenshot for the documentation, where it is wanted."""
    if PICTURES:
        target.screenshot(path=Path(PICTURES) / f"{name}.jpg", type="jpeg", quality=80)


def new_project(page: Page, title: str) -> None:
    """Create an empty project and show it."""
    page.get_by_role("button", name="New project").click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("textbox").fill(title)
    dialog.get_by_role("button", name="Create").click()
    expect(page.get_by_role("heading", name=title)).to_be_visible()


def reconstruct(page: Page) -> None:
    """Go from the list of projects to a finished scene of the first photos."""
    new_project(page, "Museum room")
    page.locator("input[type=file]").first.set_input_files([str(photo) for photo in PHOTOS])
    expect(page.get_by_role("list", name="Photos").get_by_role("listitem")).to_have_count(len(PHOTOS), timeout=60_000)
    page.get_by_text("Preview", exact=True).click()
    page.get_by_role("button", name="Reconstruct", exact=True).click()
    expect(page.get_by_role("img", name="The scene so far")).to_be_visible(timeout=RUN_MS)
    keep_picture(page, "progress")
    wait_for_scene(page, RUN_MS)


def wait_for_scene(page: Page, longest_ms: int = VIEWER_MS) -> None:
    """Wait until the viewer shows the scene."""
    expect(page.locator(".canvas-box[data-ready]")).to_be_visible(timeout=longest_ms)
    expect(page.get_by_text("Loading the scene")).to_be_hidden(timeout=VIEWER_MS)


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The server's data folder."""
    return tmp_path_factory.mktemp("server")


@pytest.fixture(scope="session")
def address(data: Path) -> Iterator[str]:
    """Start the server."""
    assert (PAGE / "dist" / "index.html").is_file(), "run `make page` first"
    with serving(data) as address:
        yield address


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Start Chromium."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("Chromium is not installed (Debian: apt-get install chromium), so the page is not tested.")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=WEBGL)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def requests_elsewhere() -> list[str]:
    """Addresses of other hosts that a page asked for, in all tests."""
    return []


@pytest.fixture
def open_page(browser: Browser, address: str, requests_elsewhere: list[str]) -> Iterator[Callable[..., Page]]:
    """Return a function that opens a page of a size. A test fails where the page reports an error.

    Chromium reports each refused request as one, which a test that has a request refused allows by its status.
    """
    problems: list[str] = []
    contexts: list[Any] = []

    def make(size: str = "desktop", path: str = "", refused: int = 0, locale: str = "en-GB") -> Page:
        width, height = PLACES[size]
        context = browser.new_context(
            viewport={"width": width, "height": height}, has_touch=size == "phone", locale=locale
        )
        contexts.append(context)
        page = context.new_page()
        allowed = f"Failed to load resource: the server responded with a status of {refused} "

        def note(message: ConsoleMessage) -> None:
            if message.type == "error" and not message.text.startswith(allowed):
                problems.append(message.text)

        page.on("console", note)
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on(
            "request",
            lambda request: (
                None if request.url.startswith((address, "blob:", "data:")) else requests_elsewhere.append(request.url)
            ),
        )
        page.goto(address + path)
        return page

    yield make
    for context in contexts:
        context.close()
    assert problems == []


@pytest.fixture(scope="session")
def scene_path(browser: Browser, address: str) -> str:
    """Address of a finished scene of the first photos, below that of the server."""
    width, height = PLACES["desktop"]
    with browser.new_context(viewport={"width": width, "height": height}) as context:
        page = context.new_page()
        page.goto(address)
        reconstruct(page)
        return f"#{page.url.partition('#')[2]}"
