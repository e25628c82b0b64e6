"""A museum's own word, taught by an object of one room, finds the like in another room."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from benchmarks.rooms.keeping import unpack_kept
from benchmarks.serve.page import serving

from .conftest import RUN_MS, keep_picture, wait_for_scene
from .test_objects import card, isolate, wait_until_lit

WORD = "ciborium"
"""Unknown to the vocabulary. Both rooms have goblets, of other materials."""
GOBLET = ("view_09.jpg", 0.565, 0.54)
"""A place on the golden goblet of the first room: a photo, and shares of its width and height."""


@pytest.fixture
def rooms(browser: Browser, tmp_path: Path) -> Iterator[tuple[Page, list[str]]]:
    """Yield a page of a server with two trained rooms, and their addresses."""
    names = ("room_1", "room_5")
    for number, name in enumerate(names):
        folder = tmp_path / "users" / "local" / "projects" / f"{number:012}"
        unpack_kept(name, folder)
        described = {"title": f"Room {number + 1}", "created": "2026-01-01T00:00:00+00:00"}
        (folder / "info.json").write_text(json.dumps(described), encoding="utf-8")
    with serving(tmp_path) as address, browser.new_page(viewport={"width": 1280, "height": 900}) as page:
        yield page, [f"{address}#/projects/{number:012}" for number in range(len(names))]


@pytest.mark.web
def test_word_taught_by_a_clicked_object_finds_the_like_in_another_room(rooms: tuple[Page, list[str]]) -> None:
    page, (first, second) = rooms
    page.goto(first)
    wait_for_scene(page)
    page.get_by_label("Learn my words").check()
    photo, x, y = GOBLET
    page.get_by_role("button", name=f"Look from {photo}").click()
    page.get_by_role("button", name="Click an object").click()
    dialog = page.get_by_role("dialog")
    expect(dialog.locator("img")).to_have_js_property("complete", True)
    box = dialog.locator(".target").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
    dialog.get_by_role("textbox").fill(WORD)
    dialog.get_by_role("button", name="Done").click()
    expect(card(page, WORD)).to_be_visible(timeout=RUN_MS)
    page.goto(second)
    expect(page.get_by_role("heading", name="Room 2")).to_be_visible()
    wait_for_scene(page)
    page.get_by_label("Learn my words").check()
    isolate(page, WORD)
    found = card(page, WORD)
    expect(found.locator("button.point[aria-pressed=true]")).to_be_visible(timeout=RUN_MS)
    wait_until_lit(page, WORD)
    page.evaluate("scrollTo(0, 0)")
    keep_picture(page, "taught_word")
