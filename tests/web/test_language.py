"""A curator sees the page, the report and an exported page in the own language."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from engine.core.language import languages

from .conftest import RUN_MS, keep_picture, wait_for_scene

GERMAN = {text: own for text, own in languages()[1].texts.items() if text != own}
SHOWN = """() => {
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const texts = [];
  while (walker.nextNode()) texts.push(walker.currentNode.data.trim());
  for (const element of document.body.querySelectorAll("[aria-label], [title], [placeholder]"))
    for (const name of ["aria-label", "title", "placeholder"]) texts.push(element.getAttribute(name) ?? "");
  return texts;
}"""
"""All texts of a page, also those for screen readers and those that are folded."""


def english(page: Page) -> set[str]:
    """Return what a page shows in English although it has German for it."""
    return {text for text in page.evaluate(SHOWN) if text in GERMAN}


@pytest.mark.web
def test_page_is_in_the_language_of_the_browser_and_can_be_changed(open_page: Callable[..., Page]) -> None:
    page = open_page(locale="de-CH")
    expect(page.get_by_role("heading", name="Projekte")).to_be_visible()
    expect(page.locator("html")).to_have_attribute("lang", "de")
    assert english(page) == set()
    page.get_by_role("combobox", name="Sprache").select_option("English")
    expect(page.get_by_role("heading", name="Projects")).to_be_visible()
    page.reload()
    expect(page.get_by_role("heading", name="Projects")).to_be_visible()
    page.get_by_role("combobox", name="Language").select_option("Deutsch")
    expect(page.get_by_role("heading", name="Projekte")).to_be_visible()


@pytest.mark.web
def test_browser_in_a_language_without_a_file_gets_english(open_page: Callable[..., Page]) -> None:
    page = open_page(locale="ja-JP")
    expect(page.get_by_role("heading", name="Projects")).to_be_visible()
    expect(page.locator("html")).to_have_attribute("lang", "en")


@pytest.mark.web
def test_whole_project_is_german_with_its_report(open_page: Callable[..., Page], scene_path: str) -> None:
    page = open_page(path=scene_path, locale="de-CH")
    wait_for_scene(page)
    page.get_by_role("button", name="Objekt anklicken").click()
    dialog = page.get_by_role("dialog")
    expect(dialog.get_by_text("Klicken Sie das Objekt")).to_be_visible()
    assert english(page) == set()
    dialog.get_by_role("button", name="Abbrechen").click()
    page.get_by_role("textbox", name="Welches Objekt?").fill("vase")
    page.get_by_role("button", name="Freistellen", exact=True).click()
    expect(page.locator("li.object, .not-found:not([hidden])").first).to_be_visible(timeout=RUN_MS)
    expect(page.locator(".job progress:visible")).to_have_count(0, timeout=RUN_MS)
    page.get_by_text("Fotos und Rekonstruktion").click()
    expect(page.get_by_text("Dauert")).to_have_count(3, timeout=RUN_MS)
    assert english(page) == set()
    page.evaluate("scrollTo(0, 0)")
    keep_picture(page, "german")
    with page.context.expect_page() as opened:
        page.get_by_role("link", name="Bericht").click()
    report = opened.value
    expect(report.get_by_role("heading", name="Fehler über der Laufzeit")).to_be_visible(timeout=RUN_MS)
    assert english(report) == set()
