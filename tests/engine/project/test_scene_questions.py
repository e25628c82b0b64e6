"""The question to a scene that is trained and its answer are the same for command line, page and Blender."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from engine.cli.main import build_parser
from engine.core.errors import FormatError, PromptError
from engine.project.scene_questions import Answers, Found, question_arguments, read_answers

ANSWERS = Answers(500, (Found("vase", "a b/1.jpg", Path("out") / "1.png"),), {"ghost": "Nothing looks like it."})


def test_answers_are_read_as_they_were_told(tmp_path: Path) -> None:
    again = read_answers(ANSWERS.outputs(), tmp_path)
    assert (again.step, again.refused) == (ANSWERS.step, ANSWERS.refused)
    # The pictures are those of the folder that was asked for, wherever the answer says that they are.
    assert again.found == (Found("vase", "a b/1.jpg", tmp_path / "1.png"),)


@pytest.mark.parametrize(
    "damage",
    [{"step": "500"}, {"found": {}}, {"found": [{"text": "vase", "photo": "a.jpg"}]}, {"refused": {"ghost": 1}}],
)
def test_answers_of_another_form_are_refused(damage: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="cannot be read"):
        read_answers({**ANSWERS.outputs(), **damage}, tmp_path)


def test_picture_outside_of_the_folder_is_refused(tmp_path: Path) -> None:
    found = [{"text": "vase", "photo": "a.jpg", "picture": "/somewhere/.."}]
    with pytest.raises(FormatError, match="leads out of the folder"):
        read_answers({**ANSWERS.outputs(), "found": found}, tmp_path)


def test_words_that_look_like_an_option_are_words(tmp_path: Path) -> None:
    asked = build_parser().parse_args(question_arguments(tmp_path, "--out=/etc, vase", tmp_path / "out"))
    assert (asked.prompt, asked.out) == ("--out=/etc, vase", tmp_path / "out")


@pytest.mark.parametrize(("words", "sentence"), [(" , ", "names nothing"), ("a, b, c, d, e, f", "at most 5 texts")])
def test_words_for_nothing_and_for_too_much_are_refused(words: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(PromptError, match=sentence):
        question_arguments(tmp_path, words, tmp_path)
