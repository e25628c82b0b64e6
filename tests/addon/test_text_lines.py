"""Lines of labels fit their width; words stay whole, and paths are broken behind separators."""

from __future__ import annotations

import importlib

import pytest

from .conftest import PACKAGE

lines_of = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.blender.text_lines").lines_of


def test_words_stay_whole_and_lines_fit() -> None:
    text = "The scene is trained again with the preset standard; cameras and masks are kept."
    lines = lines_of(text, 30, len)
    assert all(len(line) <= 30 for line in lines) and " ".join(lines) == text
    assert len(lines) == 3


@pytest.mark.parametrize("path", ["/Museum/anna/Fotos/Saal 3/vase", r"D:\Anna\Sammlung\vase_blau\project.json"])
def test_path_is_broken_behind_its_separators(path: str) -> None:
    lines = lines_of(f"The project {path} is missing.", 20, len)
    assert all(len(line) <= 20 for line in lines)
    # No name of a folder is cut.
    for name in ("Anna", "anna", "vase", "Fotos", "Sammlung"):
        assert (name in path) == any(name in line for line in lines), lines
    assert "".join(lines).replace(" ", "") == f"The project {path} is missing.".replace(" ", "")


def test_word_without_separators_is_broken_only_when_it_must_be() -> None:
    assert lines_of("a Vorführungsraumbeleuchtung b", 10, len) == ["a", "Vorführung", "sraumbeleu", "chtung b"]
    assert lines_of("a Vorführung b", 10, len) == ["a", "Vorführung", "b"]


def test_width_is_that_of_the_letters() -> None:
    def wide(text: str) -> float:
        return sum(3.0 if letter == "W" else 1.0 for letter in text)

    assert lines_of("WWW iii", 9, wide) == ["WWW", "iii"]
    assert lines_of("iii iii", 9, wide) == ["iii iii"]


def test_no_text_is_one_empty_line() -> None:
    assert lines_of("", 10, len) == [""] and lines_of("  ", 10, len) == [""]
    assert lines_of("abc", 0, len) == ["a", "b", "c"]
