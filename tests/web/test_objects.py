"""What the page shows of isolated objects, and how a curator looks around the scene."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Browser, Locator, Page, Route, expect

from benchmarks.serve.page import read_picture, serving
from engine.formats import read_ply
from engine.scene import Gaussians
from tests.conftest import wait_until

from .conftest import RUN_MS, VIEWER_MS, keep_picture, wait_for_scene
from .test_page import downloaded

OpenPage = Callable[..., Page]
SEEN = 0.002
"""Share of the pixels that differ where something is lit, hidden or dimmed: the vase covers more of every photo."""
SIZE_OF_CANVAS = "['Height', 'Width'].map((side) => document.querySelector('canvas')[`client${side}`])"
"""Height and width in CSS pixels, which are those of the picture on a screen of usual density."""
HOLD_ARROW = """
() => {
  const canvas = document.querySelector("canvas");
  setInterval(() => canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" })), 50);
}
"""
"""As while a key is held."""
LOOKS = 20
"""Pictures that are looked at until the last movement is drawn."""


@pytest.fixture
def scene(open_page: OpenPage, scene_path: str) -> Page:
    """The page of a finished scene."""
    page = open_page(path=scene_path)
    wait_for_scene(page)
    return page


def isolate(page: Page, words: str) -> None:
    """Type words, press Isolate and wait for the end."""
    page.get_by_role("textbox", name="Which object?").fill(words)
    page.get_by_role("button", name="Isolate", exact=True).click()
    expect(page.get_by_role("textbox", name="Which object?")).to_have_value("")


def card(page: Page, name: str) -> Locator:
    """Return the card of an object."""
    return page.locator("li.object").filter(has=page.locator(".object-name", has_text=re.compile(f"^{name}$")))


def wait_until_lit(page: Page, name: str) -> None:
    """Wait until the viewer has lit an object, which the page tells screen readers."""
    expect(page.get_by_text(f"{name} is lit in the scene.")).to_be_attached(timeout=VIEWER_MS)


def vase(page: Page) -> Locator:
    """Return the card of the vase, which is isolated if it is not yet."""
    found = card(page, "vase")
    if found.count() == 0:
        isolate(page, "vase")
    expect(found).to_be_visible(timeout=RUN_MS)
    return found


def object_file(page: Page, one: Locator, file: Path) -> Gaussians:
    """Return the Gaussians of the PLY that the card of an object gives."""
    if not one.get_by_role("link", name="PLY", exact=True).is_visible():
        one.get_by_text("Download").click()
    return read_ply(downloaded(page, one.get_by_role("link", name="PLY", exact=True), file))


def picture(page: Page, folder: Path) -> NDArray[np.float64]:
    """Return the picture that the viewer shows, with values from 0 to 1."""
    return read_picture(downloaded(page, page.get_by_role("button", name="Save picture"), folder / "picture.png"))


def changed(before: NDArray[np.float64], after: NDArray[np.float64]) -> float:
    """Return the share of pixels that differ clearly."""
    return float((np.abs(before - after).max(axis=2) > 0.1).mean())


@pytest.mark.web
def test_a_project_that_is_left_while_an_object_is_being_lit_says_nothing_later(scene: Page) -> None:
    vase(scene)
    # What belongs to the object is asked for again, and answered after the project was left.
    scene.reload()
    wait_for_scene(scene)
    held: list[Route] = []
    scene.route("**/members", lambda route: held.append(route))
    card(scene, "vase").locator("button.point").click()
    wait_until(lambda: scene.evaluate("1") and held)
    scene.get_by_role("link", name="← All projects").click()
    expect(scene.get_by_role("heading", name="Projects")).to_be_visible()
    with scene.expect_response("**/members"):
        held[0].continue_()
    scene.evaluate("() => new Promise((resolve) => setTimeout(resolve, 0))")
    expect(scene.get_by_text("Cannot read")).to_have_count(0)
    expect(scene.get_by_text("vase is lit in the scene.")).to_have_count(0)


@pytest.mark.web
def test_isolated_object_is_lit_hidden_and_the_rest_dimmed(scene: Page, tmp_path: Path) -> None:
    one = vase(scene)
    light = one.locator("button.point")
    if light.get_attribute("aria-pressed") == "false":
        light.click()
    expect(light).to_have_attribute("aria-pressed", "true")
    lit = picture(scene, tmp_path)
    keep_picture(scene, "lit")
    scene.get_by_label("Dim what is not lit").check()
    scene.wait_for_timeout(500)
    dimmed = picture(scene, tmp_path)
    keep_picture(scene, "dimmed")
    # The walls are the most of the picture.
    assert dimmed.mean() < 0.7 * lit.mean()
    scene.get_by_label("Dim what is not lit").uncheck()
    light.click()
    expect(light).to_have_attribute("aria-pressed", "false")
    plain = picture(scene, tmp_path)
    assert changed(plain, lit) > SEEN
    one.get_by_role("button", name="Hide vase").click()
    expect(one.get_by_role("button", name="Show vase")).to_be_visible()
    scene.wait_for_timeout(500)
    assert changed(plain, picture(scene, tmp_path)) > SEEN
    one.get_by_role("button", name="Show vase").click()
    scene.wait_for_timeout(500)
    assert changed(plain, picture(scene, tmp_path)) < SEEN / 10


@pytest.mark.web
def test_new_object_is_lit_at_once(scene: Page) -> None:
    isolate(scene, "teapot")
    one = card(scene, "teapot")
    expect(one).to_be_visible(timeout=RUN_MS)
    expect(one.locator("button.point[aria-pressed=true]")).to_be_visible(timeout=RUN_MS)


@pytest.mark.web
def test_object_has_a_picture_in_the_list(scene: Page) -> None:
    image = vase(scene).locator(".thumbnail img")
    expect(image).to_have_js_property("complete", True)
    assert image.evaluate("image => image.naturalWidth") > 0


@pytest.mark.web
def test_same_word_in_capitals_is_the_same_object(scene: Page) -> None:
    vase(scene)
    before = scene.locator("li.object").count()
    isolate(scene, "Vase")
    expect(scene.get_by_text("Found again: vase")).to_be_visible(timeout=RUN_MS)
    lit = card(scene, "vase").locator("button.point[aria-pressed=true]")
    expect(lit).to_be_visible(timeout=RUN_MS)
    expect(scene.locator("li.object")).to_have_count(before)


@pytest.mark.web
def test_model_for_any_word_is_offered_with_size_licence_and_time(scene: Page) -> None:
    isolate(scene, "xylograph")
    offer = scene.get_by_role("button", name="Know any word (155.8 MB)")
    expect(offer).to_be_visible(timeout=RUN_MS)
    offer.click()
    dialog = scene.get_by_role("dialog", name="Fetch a model that knows any word?")
    for told in (
        "clip-vit-b-32, 155.8 MB",
        "takes about a minute, once",
        "not tested",
        "MIT",
        "commercial use included",
    ):
        expect(dialog).to_contain_text(told)
    keep_picture(scene, "state_any_word")
    dialog.get_by_role("button", name="Cancel").click()
    expect(dialog).to_be_hidden()


@pytest.mark.web
def test_page_of_a_server_that_fetches_no_models_tells_what_its_owner_does(
    scene: Page, scene_path: str, data: Path, browser: Browser, tmp_path: Path
) -> None:
    isolate(scene, "xylograph")
    expect(scene.get_by_role("button", name="Know any word (155.8 MB)")).to_be_visible(timeout=RUN_MS)
    shutil.copytree(data, tmp_path / "data")
    with serving(tmp_path / "data", "--no-fetch-models") as address, browser.new_page() as page:
        page.goto(address + scene_path)
        expect(
            page.get_by_text(
                "The owner of this server fetches the model that knows any word: python -m engine models fetch"
            )
        ).to_be_visible()
        expect(page.get_by_role("button", name=re.compile("[Kk]now[s]? any word"))).to_have_count(0)


@pytest.mark.web
def test_suggested_word_is_pressed(scene: Page) -> None:
    isolate(scene, "tepot")
    words = scene.get_by_role("group", name="Words to try")
    expect(words).to_be_visible(timeout=RUN_MS)
    keep_picture(scene, "state_refused_word")
    words.get_by_role("button", name="teapot").click()
    # Until the work has ended: its result would be lit in the page of the next test.
    expect(card(scene, "teapot").locator("button.point[aria-pressed=true]")).to_be_visible(timeout=RUN_MS)


@pytest.mark.web
def test_first_view_leads_back(scene: Page, tmp_path: Path) -> None:
    first = picture(scene, tmp_path)
    canvas = scene.locator("canvas")
    canvas.focus()
    for _ in range(6):
        scene.keyboard.press("ArrowLeft")
    scene.keyboard.press("-")
    assert changed(first, picture(scene, tmp_path)) > 0.2
    scene.get_by_role("button", name="First view").click()
    # A slow computer sorts the Gaussians some frames later than it moves the camera.
    shares = [changed(first, picture(scene, tmp_path))]
    while shares[-1] >= SEEN and len(shares) < LOOKS:
        shares.append(changed(first, picture(scene, tmp_path)))
    assert shares[-1] < SEEN, shares


@pytest.mark.web
def test_picture_is_saved_sharp_while_the_camera_moves(open_page: OpenPage, scene_path: str, tmp_path: Path) -> None:
    page = open_page(path=scene_path)
    # A slow computer, which draws fewer pixels while the camera moves.
    page.add_init_script(
        "const next = window.requestAnimationFrame.bind(window);"
        "window.requestAnimationFrame = (draw) => setTimeout(() => next(draw), 200);"
    )
    page.reload()
    wait_for_scene(page, RUN_MS)
    first = picture(page, tmp_path)
    assert first.shape == (*page.evaluate(SIZE_OF_CANVAS), 3)
    page.evaluate(HOLD_ARROW)
    wait_until(lambda: page.evaluate("document.querySelector('canvas').width") < first.shape[1])
    moved = picture(page, tmp_path)
    assert moved.shape == first.shape and changed(first, moved) > 0.2


@pytest.mark.web
def test_views_are_gone_through(scene: Page) -> None:
    pressed = scene.locator(".strip button[aria-pressed=true]")
    expect(pressed).to_have_attribute("data-photo", "view_00.jpg")
    scene.get_by_role("button", name="Next view").click()
    expect(pressed).to_have_attribute("data-photo", "view_01.jpg")
    scene.locator("canvas").focus()
    scene.keyboard.press("p")
    scene.keyboard.press("p")
    expect(pressed).to_have_attribute("data-photo", "view_11.jpg")


@pytest.mark.web
def test_object_and_scene_are_seen_from_places_of_photos(scene: Page) -> None:
    one = vase(scene)
    pressed = scene.locator(".strip button[aria-pressed=true]")
    one.get_by_role("button", name="Show alone").click()
    expect(scene.get_by_role("button", name="Show the whole scene")).to_be_visible(timeout=RUN_MS)
    expect(pressed).to_have_count(0)
    one.get_by_role("button", name="Show in the scene").click()
    # No camera behind a wall: the view is that of a photo again.
    expect(pressed).to_have_count(1)
    one.locator("button.point").click()
    expect(pressed).to_have_count(1)


@pytest.mark.web
def test_wheel_over_the_picture_scrolls_the_page(scene: Page) -> None:
    pressed = scene.locator(".strip button[aria-pressed=true]")
    canvas = scene.locator("canvas")
    canvas.hover()
    scene.mouse.wheel(0, 200)
    expect(scene.get_by_text("Hold Ctrl and turn the wheel to zoom.")).to_be_visible()
    wait_until(lambda: scene.evaluate("window.scrollY") > 50)
    expect(pressed).to_have_count(1)
    scene.keyboard.down("Control")
    scene.mouse.wheel(0, 200)
    scene.keyboard.up("Control")
    expect(pressed).to_have_count(0)


@pytest.mark.web
def test_length_is_measured_in_the_scene(scene: Page) -> None:
    scene.get_by_role("button", name="Measure").click()
    box = scene.locator("canvas").bounding_box()
    assert box is not None
    for share in (0.3, 0.45):
        scene.mouse.click(box["x"] + share * box["width"], box["y"] + 0.5 * box["height"])
    expect(scene.locator(".measured")).to_contain_text("units. The unit of length is not known")
    expect(scene.get_by_text("Is this an object?")).to_be_hidden()
    keep_picture(scene, "measure")


@pytest.mark.web
def test_scene_and_object_are_downloaded_as_spz_and_usd(scene: Page, tmp_path: Path) -> None:
    scene.get_by_text("Download the scene").click()
    for name in ("SPZ", "USD"):
        link = scene.locator(".menu").get_by_role("link", name=name)
        assert downloaded(scene, link, tmp_path / name).stat().st_size > 1000
    one = vase(scene)
    one.get_by_text("Download").click()
    assert downloaded(scene, one.get_by_role("link", name="SPZ"), tmp_path / "one").stat().st_size > 100


@pytest.mark.slow
def test_object_gets_detail_which_is_shown_and_downloaded(scene: Page, tmp_path: Path) -> None:
    one = vase(scene)
    before = object_file(scene, one, tmp_path / "before.ply")
    expect(one).not_to_contain_text("with detail")
    one.get_by_role("button", name="Show alone").click()
    expect(scene.get_by_role("button", name="Show the whole scene")).to_be_visible(timeout=RUN_MS)
    expect(scene.locator(".loading")).to_be_hidden()
    scene.wait_for_timeout(500)
    plain = picture(scene, tmp_path)
    one.get_by_role("button", name="Add detail", exact=True).click()
    told = scene.locator("p.quiet", has_text="Detail from the photos: vase.")
    expect(told).to_be_visible(timeout=RUN_MS)
    # What is shown alone is shown anew.
    expect(one).to_contain_text("with detail")
    wait_until(lambda: changed(plain, picture(scene, tmp_path)) > SEEN)
    expect(scene.get_by_text("vase alone")).to_be_visible()
    keep_picture(scene, "detail")
    after = object_file(scene, one, tmp_path / "after.ply")
    assert len(after) > len(before) > 0


@pytest.mark.web
def test_report_has_the_title_of_the_project_and_its_objects(scene: Page) -> None:
    vase(scene)
    address = scene.get_by_role("link", name="Report").get_attribute("href")
    assert address is not None
    answer = scene.request.get(f"{scene.url.partition('#')[0].rstrip('/')}{address}", timeout=RUN_MS)
    text = answer.text()
    assert "<h1>Museum room</h1>" in text and "<h3>vase</h3>" in text


@pytest.mark.web
def test_photos_are_one_stop_of_the_tab_key(scene: Page) -> None:
    strip = scene.locator(".strip button")
    assert strip.count() == 12
    expect(scene.locator(".strip button[tabindex='0']")).to_have_count(1)
    strip.first.focus()
    scene.keyboard.press("ArrowRight")
    expect(strip.nth(1)).to_be_focused()
    scene.get_by_text("Photos and reconstruction").click()
    expect(scene.locator(".photos button[tabindex='0']")).to_have_count(1)


@pytest.mark.web
def test_long_name_is_not_wider_than_a_phone(open_page: OpenPage, scene_path: str) -> None:
    page = open_page("phone", scene_path)
    wait_for_scene(page)
    vase(page)
    for name in ("Donaudampfschifffahrtsgesellschaftskapitänsmütze" * 2, "Museum room"):
        page.get_by_role("button", name="Rename").click()
        page.get_by_role("dialog").get_by_role("textbox").fill(name)
        page.get_by_role("dialog").get_by_role("button", name="Rename").click()
        expect(page.get_by_role("heading", name=name)).to_be_visible()
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        assert page.evaluate("document.querySelector('h1').scrollWidth <= document.querySelector('h1').clientWidth")


@pytest.mark.web
def test_projects_have_pictures(open_page: OpenPage, scene_path: str) -> None:
    page = open_page()
    image = page.get_by_role("listitem").filter(has_text=re.compile("Museum room")).locator("img")
    expect(image).to_have_js_property("complete", True)
    assert image.evaluate("image => image.naturalWidth") > 0
    keep_picture(page, "projects")
