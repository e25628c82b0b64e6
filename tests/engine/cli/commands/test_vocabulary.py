"""`vocabulary`: what objects have taught is listed, forgotten, exported and imported; a project learns when told to."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.project.folder import ProjectFolder
from engine.project.own_words import Example, OwnWords, learns_words
from tests.engine.command_line import call


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file of the user's own vocabulary, with two words."""
    monkeypatch.setenv("GAUSSIAN_HERITAGE_CACHE", str(tmp_path / "cache"))
    file = tmp_path / "cache" / "own_words.json"
    file.parent.mkdir()
    vector = np.ones(3, np.float32)
    taught = [("mask", "a"), ("mask", "b"), ("bell", "c")]
    OwnWords(file).add([Example(word, one, "s", "offline-vocabulary", "f", "2026", vector) for word, one in taught])
    return file


def message(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    (finished,) = call(capsys, "vocabulary", *words).of_kind("finished")
    return str(finished["message"])


def test_words_are_listed_with_their_examples_beside_the_models(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert message(capsys, "list") == "bell: 1 example (offline-vocabulary)\nmask: 2 examples (offline-vocabulary)"
    (answer,) = call(capsys, "vocabulary", "list").of_kind("finished")
    assert answer["outputs"]["file"] == str(file)


def test_forgotten_word_comes_back_from_an_export(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "copy.json"
    assert message(capsys, "export", copy) == f"Exported 3 examples to {copy}."
    assert message(capsys, "forget", "Masks") == "Forgot 'Masks', 2 examples."
    assert message(capsys, "list") == "bell: 1 example (offline-vocabulary)"
    assert "does not have 'masks'" in call(capsys, "vocabulary", "forget", "masks").error
    assert message(capsys, "import", copy) == "Imported 3 examples."
    assert len(OwnWords(file).examples()) == 3


def test_empty_vocabulary_says_so_and_exports_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = ["--own-words", tmp_path / "none.json"]
    assert message(capsys, "list", *own) == "Your own vocabulary is empty."
    assert "nothing was exported" in call(capsys, "vocabulary", "export", tmp_path / "copy.json", *own).error
    assert not (tmp_path / "copy.json").exists()
    assert "copy.json cannot be read" in call(capsys, "vocabulary", "import", tmp_path / "copy.json", *own).error


def test_project_learns_and_stops(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = ProjectFolder.create(tmp_path / "scene").path
    assert message(capsys, "learn", scene).startswith("scene learns from now on")
    assert learns_words(ProjectFolder.open_existing(scene))
    assert "learns no longer" in message(capsys, "stop", scene)
    assert not learns_words(ProjectFolder.open_existing(scene))
    assert "is not a Gaussian Heritage project" in call(capsys, "vocabulary", "learn", tmp_path / "none").error


@pytest.mark.parametrize(
    ("words", "said"),
    [(["list", "mask"], "takes nothing more"), (["forget"], "takes a word"), (["learn"], "a project")],
)
def test_unusable_arguments_are_a_sentence(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert said in call(capsys, "vocabulary", *words).error
