"""Names that cannot be stored or shown are refused with a reason."""

from __future__ import annotations

import pytest

from engine.photos.names import problem_of_name


@pytest.mark.parametrize("name", ["a.jpg", "Götter und Vasen/彫刻 1.jpg", "a\\b 'c' \"d\".jpg", "👩‍🎨.png"])
def test_usual_name_is_used(name: str) -> None:
    assert problem_of_name(name) is None


@pytest.mark.parametrize("name", ["a\x1b[31m.jpg", "a\n.jpg", "a\x85.jpg", "a\u2028.jpg", "a\u202egpj.exe.jpg"])
def test_name_with_control_characters_is_refused(name: str) -> None:
    assert problem_of_name(name) == "Its name has control characters. Rename it."


@pytest.mark.parametrize("name", ["caf\udce9.jpg", "sub\udcff/a.jpg", "a\ud800.jpg"])
def test_name_that_is_not_utf8_is_refused(name: str) -> None:
    assert problem_of_name(name) == "Its name has bytes that are not UTF-8. Rename it."


def test_name_that_no_file_system_takes_is_refused() -> None:
    assert problem_of_name("花" * 85 + ".jpg") == (
        "Its name is too long: a part of it has 259 bytes, and file systems take at most 255. Rename it."
    )
    assert problem_of_name("花" * 83 + "ab.jpg") is None
