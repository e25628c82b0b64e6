"""An error is shown as one sentence; the traceback of an unexpected one is in the log file that the sentence names."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from .conftest import PACKAGE

problems = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.blender.problems")
errors = importlib.import_module(f"{PACKAGE}.engine.core.errors")


@pytest.fixture
def log(tmp_path: Path) -> Iterator[Path]:
    """Log to a temporary folder, and yield the file."""
    problems.set_log_folder(lambda: tmp_path)
    problems._logged.clear()
    yield tmp_path / "errors.log"
    problems.set_log_folder(None)
    problems.clear()


def raised(error: Exception) -> Any:
    """Return `error` with a traceback."""
    try:
        raise error
    except Exception as caught:
        return caught


def test_our_own_error_is_its_sentence_and_is_not_logged(log: Path) -> None:
    assert problems.sentence_of(raised(errors.PhotoError("No photo.\nChoose another folder."))) == (
        "No photo. Choose another folder."
    )
    assert not log.exists()


@pytest.mark.parametrize("error", [KeyError("x"), RuntimeError(), UnicodeDecodeError("utf-8", b"\xff", 0, 1, "bad")])
def test_unexpected_error_is_a_sentence_and_the_log_has_its_traceback(error: Exception, log: Path) -> None:
    sentence = problems.sentence_of(raised(error))
    assert sentence.startswith(f"An unexpected error occurred: {type(error).__name__}")
    assert sentence.endswith(f"details are in {log}. Please report it.") and "\n" not in sentence
    assert "Traceback (most recent call last)" in log.read_text(encoding="utf-8") and "in raised" in log.read_text(
        encoding="utf-8"
    )


def test_full_memory_is_told_from_mistakes(log: Path) -> None:
    assert "There is not enough memory (MemoryError)" in problems.sentence_of(raised(MemoryError()))


def test_same_error_is_logged_once(log: Path) -> None:
    for _ in range(100):
        problems.sentence_of(raised(KeyError("x")))
    problems.sentence_of(raised(KeyError("y")))
    assert log.read_text(encoding="utf-8").count("Traceback (most recent call last)") == 2


def test_long_and_unprintable_errors_can_be_shown(log: Path) -> None:
    sentence = problems.sentence_of(raised(ValueError("\ud800 \x1b[31m\0" + "x" * 10_000)))
    assert len(sentence) < 400 + len(str(log)) and "\x1b" not in sentence and "\\ud800" in sentence
    assert "x" * 10_000 in log.read_text(encoding="utf-8")


def test_log_that_cannot_be_written_does_not_hide_the_error(tmp_path: Path) -> None:
    def missing() -> Path:
        raise OSError("no folder")

    for find in (missing, lambda: tmp_path / "nowhere", None):
        problems.set_log_folder(find)
        assert "KeyError: 'x'; details could not be saved" in problems.sentence_of(raised(KeyError("x")))
    problems.set_log_folder(None)
