"""The page that an export makes: it opens from the disk without the web, and looks like the engine's picture."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from engine.cli.main import main
from engine.delivery.packages.page import is_viewer_built
from engine.formats import read_ply
from engine.project.objects import MuseumRecord, ObjectRecord, save_object, save_record
from engine.scene import Gaussians
from engine.scene.camera import Camera
from tests.conftest import wait_until
from tests.engine.objects.fakes import trained_project
from tests.engine.pictures.blob_scene import BLUE, make_scene

from .conftest import PLACES, VIEWER_MS
from .test_language import english
from .test_page import AXE, engine_picture, read_picture

TITLE = "Ölkanne <script>alert(1)</script>"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene of three balls, one of which is an object with a record."""
    assert is_viewer_built(), "run `make page` first"
    blobs = make_scene()
    made = trained_project(blobs, tmp_path_factory.mktemp("scene"))
    count = int((blobs.part == BLUE).sum())
    record = ObjectRecord("ball", "Ball", {"kind": "text", "text": "ball"}, 0.5, 0.9, 0.95, count, len(blobs.part))
    save_object(made.path, record, (blobs.part == BLUE).astype(np.float32))
    save_record(made.path, "ball", MuseumRecord("1906.12", TITLE, "CC BY 4.0", "two\nlines"))
    return made.path


@pytest.fixture(scope="module")
def pages(project: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The exported pages of the object and of the scene."""
    folder = tmp_path_factory.mktemp("pages")
    for name, words in (("object", ["--object", "ball"]), ("scene", [])):
        assert main(["export", str(project), "--format", "html", "--out", str(folder / f"{name}.html"), *words]) == 0
    return {name: folder / f"{name}.html" for name in ("object", "scene")}


@pytest.fixture
def open_file(browser: Browser) -> Iterator[Callable[..., Page]]:
    """Return a function that opens a file without a network. A test fails where the page reports an error."""
    problems: list[str] = []
    contexts = []

    def make(file: Path, size: str = "desktop", locale: str = "en-GB") -> Page:
        width, height = PLACES[size]
        context = browser.new_context(
            viewport={"width": width, "height": height}, has_touch=size == "phone", offline=True, locale=locale
        )
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: problems.append(str(error)))
        own = file.as_uri()
        page.on(
            "request", lambda one: None if one.url.startswith((own, "blob:", "data:")) else problems.append(one.url)
        )
        page.goto(own)
        expect(page.locator(".canvas-box[data-ready]")).to_be_visible(timeout=60_000)
        return page

    yield make
    for context in contexts:
        context.close()
    assert problems == []


@pytest.mark.web
def test_page_is_in_the_language_of_its_reader(open_file: Callable[..., Page], pages: dict[str, Path]) -> None:
    page = open_file(pages["scene"], locale="de-CH")
    expect(page.locator("html")).to_have_attribute("lang", "de")
    expect(page.get_by_role("heading", name="Wie es entstand")).to_be_visible()
    expect(page.get_by_role("button", name="Bild speichern")).to_be_visible()
    assert english(page) == set()


def saved_picture(page: Page, file: Path) -> np.ndarray:
    with page.expect_download() as begun:
        page.get_by_role("button", name="Save picture").click()
    begun.value.save_as(file)
    return read_picture(file)


def share_of_blue(shown: np.ndarray) -> float:
    """Return the share of pixels that are blue rather than red."""
    return float((shown[..., 2] - shown[..., 0] > 0.3).mean())


@pytest.mark.web
def test_page_shows_title_record_and_unit_and_runs_no_script_of_the_record(
    open_file: Callable[..., Page], pages: dict[str, Path]
) -> None:
    page = open_file(pages["object"])
    expect(page.get_by_role("heading", name=TITLE)).to_be_visible()
    record = page.locator("dl.record").first
    for words in ("1906.12", "CC BY 4.0", "two\nlines", "is not known, because no distance was given", "0.95"):
        expect(record).to_contain_text(words)


@pytest.mark.web
def test_scene_looks_as_the_engine_renders_it(
    open_file: Callable[..., Page], pages: dict[str, Path], project: Path, tmp_path: Path
) -> None:
    page = open_file(pages["scene"])
    shown = saved_picture(page, tmp_path / "shown.png")
    view = json.loads(re.search(r'id="data">(.*?)</script>', pages["scene"].read_text())[1])["views"][0]  # type: ignore[index]
    camera = Camera(
        "view", view["width"], view["height"], "PINHOLE", (view["fx"], view["fy"], view["cx"], view["cy"]),
        np.reshape(view["world_to_camera"], (4, 4)),
    )  # fmt: skip
    expected = engine_picture(project, camera, shown.shape[1], shown.shape[0], tmp_path)
    # The same bound as for the page of the server, for the same reasons.
    assert -10 * np.log10(np.mean((shown - expected) ** 2)) >= 28.0


@pytest.mark.web
def test_object_of_an_exported_scene_is_lit_hidden_and_the_rest_dimmed(
    open_file: Callable[..., Page], pages: dict[str, Path], tmp_path: Path
) -> None:
    page = open_file(pages["scene"])
    plain = saved_picture(page, tmp_path / "plain.png")
    page.get_by_role("button", name="Hide ball").click()
    expect(page.get_by_role("button", name="Show ball")).to_be_visible()
    # The blue ball is in the picture of the first view, as it is between the others.
    assert share_of_blue(plain) > 0.002
    wait_until(lambda: share_of_blue(saved_picture(page, tmp_path / "hidden.png")) < 0.0005)
    light = page.locator("button.point")
    light.click()
    expect(light).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_text("is lit in the scene.")).to_be_attached(timeout=VIEWER_MS)
    lit = saved_picture(page, tmp_path / "lit.png")
    page.get_by_label("Dim what is not lit").check()
    wait_until(lambda: saved_picture(page, tmp_path / "dimmed.png").mean() < 0.9 * lit.mean())
    page.get_by_role("button", name="First view").click()
    light.click()
    page.get_by_label("Dim what is not lit").uncheck()
    wait_until(lambda: np.abs(saved_picture(page, tmp_path / "again.png") - plain).max() < 0.1)


@pytest.mark.web
def test_page_of_an_object_has_no_list_of_objects(open_file: Callable[..., Page], pages: dict[str, Path]) -> None:
    expect(open_file(pages["object"]).locator("section.parts")).to_be_hidden()


@pytest.mark.web
def test_view_is_turned_and_measured_by_keyboard_alone(open_file: Callable[..., Page], pages: dict[str, Path]) -> None:
    page = open_file(pages["object"])
    canvas = page.locator("canvas")
    page.keyboard.press("Tab")
    expect(canvas).to_be_focused()
    before = canvas.screenshot()
    page.keyboard.press("ArrowLeft")
    wait_until(lambda: canvas.screenshot() != before)
    page.keyboard.press("m")
    measured = page.locator(".measured")
    page.keyboard.press("Enter")
    expect(measured).to_contain_text("Now the second point")
    page.keyboard.press("Shift+ArrowUp")
    page.keyboard.press("Enter")
    expect(measured).to_contain_text("units. The unit of length is not known")
    expect(page.locator("svg.line circle")).to_have_count(2)
    page.keyboard.press("Escape")
    expect(measured).to_be_hidden()


@pytest.mark.web
def test_a_ball_measures_its_diameter(open_file: Callable[..., Page], pages: dict[str, Path]) -> None:
    """Two clicks at the left and the right edge of the ball are its width apart."""
    text = pages["object"].read_text()
    packed = re.search(r'id="splats">([^<]*)</script>', text)
    assert packed is not None
    file = pages["object"].with_name("splats.ply")
    file.write_bytes(gzip.decompress(base64.b64decode(packed[1])))
    gaussians: Gaussians = read_ply(file)
    inner = np.ptp(gaussians.means[:, :2], axis=0).max()
    outer = inner + 4 * gaussians.scales.max()
    page = open_file(pages["object"])
    page.get_by_role("button", name="Measure").click()
    box = page.locator("canvas").bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    hits = []
    for x in np.arange(box["x"] + box["width"] * 0.25, box["x"] + box["width"] * 0.75, 8.0):
        page.mouse.click(float(x), middle)
        said = page.locator(".measured").inner_text()
        if "nothing at that place" not in said:
            hits.append(float(x))
    assert len(hits) > 10
    page.keyboard.press("Escape")
    page.locator("canvas").focus()
    page.keyboard.press("m")
    for x in (hits[0], hits[-1]):
        page.mouse.click(x, middle)
    found = re.match(r"([\d.e-]+) units", page.locator(".measured").inner_text())
    assert found is not None
    # Rays are half blocked somewhere between the centres of the outermost Gaussians and twice their size beyond.
    assert inner <= float(found[1]) <= outer


@pytest.mark.web
@pytest.mark.parametrize("size", ["desktop", "phone"])
def test_page_is_accessible_and_not_wider_than_the_screen(
    open_file: Callable[..., Page], pages: dict[str, Path], size: str
) -> None:
    page = open_file(pages["object"], size)
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    # The page's policy allows no foreign script, so axe is run in a page without it that has the same content.
    context = page.context.browser.new_context(bypass_csp=True, viewport=page.viewport_size)  # type: ignore[union-attr]
    checked = context.new_page()
    checked.goto(pages["object"].as_uri())
    expect(checked.locator(".canvas-box[data-ready]")).to_be_visible(timeout=60_000)
    checked.evaluate(AXE.read_text())
    found = checked.evaluate("axe.run()")["violations"]
    context.close()
    assert [f"{one['id']}: {one['nodes'][0]['html'][:200]}" for one in found] == []
