"""What the page shows in each state: empty, uploading, waiting, running, failed, server gone, signed out."""

from __future__ import annotations

import base64
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, Route, expect

from benchmarks.serve.page import serving, started_server
from engine.core.stage_names import STAGE_NAMES

from .conftest import PAGE, PHOTOS, PLACES, ROOT, RUN_MS, keep_picture, new_project

OpenOwn = Callable[..., Page]
HIDDEN_TAB = """
() => {
  window.told = [];
  window.Notification = class {
    static permission = "granted";
    constructor(title, { body }) { window.told.push(body); }
  };
  Object.defineProperty(document, "hidden", { get: () => true });
}
"""
"""Makes the page believe that another tab is seen, and keeps the texts of its notifications."""
SHOWN_STAGES = """
() => {
  window.stages = "";
  const note = () => document.querySelectorAll("p.stage").forEach((shown) => { window.stages += shown.textContent; });
  new MutationObserver(note).observe(document.body, { childList: true, characterData: true, subtree: true });
}
"""
"""Keeps all stages that the page shows from then on, so that none is missed however short it is."""


class OwnServer:
    """A server of a test's own, which can be ended and started again at the same address."""

    def __init__(self, data: Path, *more: str) -> None:
        self._data, self._more = data, more
        self._stack = ExitStack()
        self.address = self._stack.enter_context(serving(data, *more))

    def kill(self) -> None:
        """End it as a loss of power does."""
        self._stack.close()

    def start_again(self) -> None:
        """Start it at the same address."""
        port = re.sub(r"\D", "", self.address.rsplit(":", 1)[1])
        self._stack.enter_context(serving(self._data, *self._more, f"--port={port}"))


@pytest.fixture
def server(tmp_path: Path) -> Iterator[OwnServer]:
    """A new server without projects."""
    started = OwnServer(tmp_path / "data")
    yield started
    started.kill()


@pytest.fixture
def open_own(browser: Browser) -> Iterator[OpenOwn]:
    """Return a function that opens an address in a window of its own."""
    contexts = []

    def make(address: str, size: str = "desktop") -> Page:
        width, height = PLACES[size]
        context = browser.new_context(
            viewport={"width": width, "height": height}, has_touch=size == "phone", ignore_https_errors=True
        )
        contexts.append(context)
        page = context.new_page()
        page.goto(address)
        return page

    yield make
    for context in contexts:
        context.close()


def choose(page: Page, files: list[Path]) -> None:
    """Choose files for the shown project."""
    page.locator("input[type=file]").first.set_input_files([str(file) for file in files])


def photo_tiles(page: Page) -> object:
    return page.get_by_role("list", name="Photos").get_by_role("listitem")


def grey_photos(folder: Path) -> list[Path]:
    """Photos that can be read and show nothing, so that no cameras are found."""
    folder.mkdir()
    files = [folder / f"grey_{number}.jpg" for number in range(3)]
    for number, file in enumerate(files):
        cv2.imwrite(str(file), np.full((480, 640, 3), 100 + 20 * number, np.uint8))
    return files


@pytest.mark.web
@pytest.mark.parametrize("size", ["desktop", "phone"])
def test_an_empty_server_says_how_to_begin(server: OwnServer, open_own: OpenOwn, size: str) -> None:
    page = open_own(server.address, size)
    expect(page.get_by_text("Turn photos of museum objects into 3D.")).to_be_visible()
    expect(page.get_by_role("heading", name="1. Take photos")).to_be_visible()
    assert "[object" not in page.locator("body").inner_text()
    keep_picture(page, f"state_empty_{size}")


@pytest.mark.web
def test_photos_of_one_name_are_all_taken(server: OwnServer, open_own: OpenOwn, tmp_path: Path) -> None:
    """The camera of a phone calls each photo image.jpg."""
    page = open_own(server.address)
    new_project(page, "Phone")
    for number, photo in enumerate(PHOTOS[:3], start=1):
        folder = tmp_path / str(number)
        folder.mkdir()
        file = folder / "image.jpg"
        file.write_bytes(photo.read_bytes())
        choose(page, [file])
        expect(photo_tiles(page)).to_have_count(number, timeout=20_000)  # type: ignore[arg-type]


@pytest.mark.web
def test_upload_is_shown_while_it_runs(server: OwnServer, open_own: OpenOwn) -> None:
    page = open_own(server.address)
    held = []
    page.route(re.compile("/uploads/.+"), lambda route: held.append(route))  # never answered
    new_project(page, "Upload")
    choose(page, PHOTOS[:4])
    expect(page.get_by_text("Uploading: 0 of 4 files")).to_be_visible()
    keep_picture(page, "state_uploading")


@pytest.mark.web
def test_removing_a_photo_is_asked_first_and_it_is_brought_back(server: OwnServer, open_own: OpenOwn) -> None:
    page = open_own(server.address)
    new_project(page, "Remove")
    choose(page, PHOTOS[:2])
    expect(photo_tiles(page)).to_have_count(2, timeout=20_000)  # type: ignore[arg-type]
    page.get_by_role("button", name=f"Remove {PHOTOS[0].name}").click()
    page.get_by_role("dialog").get_by_role("button", name="Cancel").click()
    expect(photo_tiles(page)).to_have_count(2)  # type: ignore[arg-type]
    page.get_by_role("button", name=f"Remove {PHOTOS[0].name}").click()
    page.get_by_role("dialog").get_by_role("button", name="Remove", exact=True).click()
    expect(photo_tiles(page)).to_have_count(1)  # type: ignore[arg-type]
    page.get_by_text("Removed: 1 file").click()
    page.get_by_role("button", name=f"Bring {PHOTOS[0].name} back").click()
    expect(photo_tiles(page)).to_have_count(2)  # type: ignore[arg-type]


@pytest.mark.web
def test_damaged_video_is_seen_and_replaced(server: OwnServer, open_own: OpenOwn, tmp_path: Path) -> None:
    page = open_own(server.address)
    new_project(page, "Video")
    video = tmp_path / "walk.mp4"
    write_video(video)
    whole = video.read_bytes()
    video.write_bytes(whole[: len(whole) // 3])
    choose(page, [video])
    tile = photo_tiles(page).filter(has_text="walk.mp4")  # type: ignore[attr-defined]
    expect(tile).to_contain_text("Remove it, then choose a copy that plays.", timeout=60_000)
    keep_picture(page, "state_damaged_video")
    page.get_by_role("button", name="Remove walk.mp4").click()
    page.get_by_role("dialog").get_by_role("button", name="Remove", exact=True).click()
    expect(tile).to_have_count(0)
    video.write_bytes(whole)
    choose(page, [video])
    expect(tile).to_contain_text("8 photos taken from it", timeout=60_000)
    tile.get_by_role("button", name="Take more photos").click()
    expect(tile).to_contain_text("16 photos taken from it", timeout=60_000)


def write_video(file: Path) -> None:
    """A film of three seconds that moves over one of the photos."""
    photo = cv2.imread(str(PHOTOS[0]))
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"mp4v"), 30, (320, 240))
    for number in range(90):
        writer.write(photo[100 : 100 + 240, number : number + 320])
    writer.release()


@pytest.mark.web
def test_preset_tells_its_time_before_it_is_started(server: OwnServer, open_own: OpenOwn) -> None:
    page = open_own(server.address)
    new_project(page, "Times")
    choose(page, PHOTOS)
    expect(photo_tiles(page)).to_have_count(len(PHOTOS), timeout=60_000)  # type: ignore[arg-type]
    for preset in ("Preview", "Standard", "Best"):
        choice = page.locator("label.choice").filter(has=page.get_by_text(preset, exact=True))
        expect(choice).to_contain_text(re.compile(r"Takes (about|less than)"), timeout=RUN_MS)
    keep_picture(page, "state_ready")


@pytest.mark.slow
@pytest.mark.web
def test_work_is_shown_while_it_waits_runs_and_fails(server: OwnServer, open_own: OpenOwn, tmp_path: Path) -> None:
    running = open_own(server.address)
    new_project(running, "Running")
    choose(running, PHOTOS)
    expect(photo_tiles(running)).to_have_count(len(PHOTOS), timeout=60_000)  # type: ignore[arg-type]
    waiting = open_own(server.address)
    waiting.evaluate(HIDDEN_TAB)
    new_project(waiting, "Waiting")
    choose(waiting, grey_photos(tmp_path / "grey"))
    expect(photo_tiles(waiting)).to_have_count(3, timeout=60_000)  # type: ignore[arg-type]
    running.evaluate(SHOWN_STAGES)
    running.get_by_role("button", name="Reconstruct", exact=True).click()
    waiting.get_by_role("button", name="Reconstruct", exact=True).click()
    expect(waiting.get_by_text("The server is busy with other work.")).to_be_visible()
    keep_picture(waiting, "state_waiting")
    waiting.get_by_role("button", name="Notify me at the end").click()
    # The stage in words, and the time of all stages as soon as there is a forecast.
    running.wait_for_function("name => window.stages.includes(name)", arg=STAGE_NAMES["cameras"], timeout=RUN_MS)
    expect(running.get_by_text(re.compile("left in all"))).to_be_visible(timeout=RUN_MS)
    keep_picture(running, "state_running")
    running.get_by_role("button", name="Stop").click()
    running.get_by_role("dialog").get_by_role("button", name="Stop").click()
    expect(running.get_by_role("heading", name="Reconstruct the scene: stopped")).to_be_visible(timeout=RUN_MS)
    expect(running.get_by_text("What is computed so far is kept. Continue goes on from there.")).to_be_visible()
    expect(running.get_by_role("button", name="Continue")).to_be_visible()
    keep_picture(running, "state_stopped")
    expect(waiting.get_by_role("heading", name="could not be finished")).to_be_visible(timeout=RUN_MS)
    keep_picture(waiting, "state_failed")
    told = "Reconstruct the scene: could not be finished"
    assert waiting.evaluate("window.told") == [told]
    assert waiting.title() == f"✓ {told}"


@pytest.mark.web
def test_server_that_is_gone_is_told_and_comes_back(server: OwnServer, open_own: OpenOwn) -> None:
    page = open_own(server.address)
    new_project(page, "Gone")
    server.kill()
    told = page.get_by_text("The server cannot be reached.")
    expect(told).to_be_visible(timeout=20_000)
    keep_picture(page, "state_gone")
    server.start_again()
    expect(told).to_be_hidden(timeout=20_000)


@pytest.mark.web
def test_nobody_is_signed_in(open_own: OpenOwn, tmp_path: Path) -> None:
    added = [sys.executable, "-m", "engine", "serve", f"--data={tmp_path}", "--add-user=ada"]
    said = subprocess.run(added, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    with serving(tmp_path, "--lan") as address:
        page = open_own(address)
        expect(page.get_by_role("heading", name="Sign in")).to_be_visible()
        keep_picture(page, "state_signed_out")
        page.get_by_label("Access token").fill("wrong")
        page.get_by_role("button", name="Sign in").click()
        expect(page.get_by_text("This token is not known.")).to_be_visible()
        page.get_by_label("Access token").fill(max(re.findall(r"[\w-]+", said), key=len))
        page.get_by_role("button", name="Sign in").click()
        expect(page.get_by_role("heading", name="Projects")).to_be_visible()


@pytest.mark.web
def test_phone_that_scans_the_code_is_signed_in_and_uploads(open_own: OpenOwn, tmp_path: Path) -> None:
    """Through the address of this computer in its network, as another device reaches it."""
    with started_server(tmp_path, "--lan", "--first-user=ada") as said:
        link = next(filter(None, (scanned(json.loads(line).get("message", "")) for line in said)))
        address, _, code = link.partition("#/sign-in/")
        assert code and not re.search(r"//(127\.|localhost)", address)
        phone = open_own(link, "phone")
        expect(phone.get_by_role("heading", name="Projects")).to_be_visible()
        expect(phone.get_by_text("ada", exact=True)).to_be_visible()
        # The code is not left in the address, and the session outlives a reload.
        assert code not in phone.url
        phone.reload()
        new_project(phone, "From the phone")
        choose(phone, PHOTOS[:2])
        expect(photo_tiles(phone)).to_have_count(2, timeout=60_000)  # type: ignore[arg-type]
        keep_picture(phone, "state_phone_signed_in")
        # It serves once.
        other = open_own(link, "phone")
        expect(other.get_by_role("heading", name="Sign in")).to_be_visible()


def scanned(text: str) -> str:
    """Return what a QR code of half blocks in a text of a terminal says; empty without one."""
    rows = [line for line in text.splitlines() if line and set(line) <= set("█▀▄ ")]
    if not rows:
        return ""
    upper = [[char in "█▀" for char in row] for row in rows]
    lower = [[char in "█▄" for char in row] for row in rows]
    # The blocks are the light modules, as terminals are dark.
    light = np.array([row for pair in zip(upper, lower, strict=True) for row in pair])
    picture = np.kron(np.pad(light, 4, constant_values=True), np.ones((8, 8))).astype(np.uint8) * 255
    return cv2.QRCodeDetector().detectAndDecode(picture)[0]


@pytest.mark.web
def test_page_appends_by_one_function_alone() -> None:
    """`Element.append` and `replaceChildren` write "[object ...]" for a list of elements."""
    for file in (PAGE / "src").glob("**/*.js"):
        calls = re.findall(r"\.(?:append|prepend|replaceChildren)\(", file.read_text())
        assert file.name == "dom.js" or not calls, file


@pytest.mark.web
def test_words_are_asked_of_the_scene_while_it_is_trained(server: OwnServer, open_own: OpenOwn) -> None:
    """The state of the project and the answer of the engine are made up: a training would end before they are seen."""
    page = open_own(server.address)
    job = {
        "id": "1", "kind": "reconstruct", "label": "Reconstruct", "subject": "", "state": "running",
        "stage": "training", "fraction": 0.6, "seconds_left": 60.0, "seconds_left_in_all": 90.0, "message": "",
        "warnings": [], "error": "", "curve": [], "preview": False, "objects": [],
    }  # fmt: skip

    def in_training(route: Route) -> None:
        answer = route.fetch()
        route.fulfill(response=answer, json={**answer.json(), "job": job})

    picture = base64.b64encode(PHOTOS[3].read_bytes()).decode("ascii")
    found = [{"text": "vase", "photo": PHOTOS[3].name, "picture": f"data:image/jpeg;base64,{picture}"}]
    answer = {"step": 500, "found": found, "refused": {"ghost": "Nothing in the scene looks like 'ghost'."}}
    page.route("**/ask", lambda route: route.fulfill(json=answer))
    page.route(re.compile(r"/api/v1/projects/[^/]+$"), in_training)
    new_project(page, "Room")
    page.get_by_label("What is in it?").fill("vase, ghost")
    page.get_by_role("button", name="Ask the scene so far").click()
    progress = page.get_by_role("region", name="Progress")
    expect(progress.get_by_text("The scene after step 500 of its training. Nothing is stored.")).to_be_visible()
    expect(progress.get_by_text("Nothing in the scene looks like 'ghost'.")).to_be_visible()
    expect(progress.get_by_text(f"vase in {PHOTOS[3].name}")).to_be_visible()
    expect(progress.locator(".candidates img")).to_be_visible()
    keep_picture(page, "state_asked")
    job["stage"] = "report"
    page.reload()
    expect(page.get_by_role("heading", name="Reconstruct")).to_be_visible()
    expect(page.get_by_label("What is in it?")).to_be_hidden()
