"""Candidates for prompts that were not found are read from the project as the engine writes them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from engine.core import errors
from engine.project import refused_prompts as candidates

STORED = {
    "version": 1,
    "created": "2026-11-21T10:45:00+00:00",
    "refused": [{"text": "banana", "message": "Nothing looks enough like 'banana'."}],
    "candidates": [
        {
            "number": 2, "text": "banana", "score": 0.21, "photo": "view_05.jpg", "x": 412.0, "y": 300.5,
            "box": [380.0, 250.0, 450.0, 350.0], "n_gaussians": 345, "picture": "objects/_candidates/2.png",
        }
    ],
}  # fmt: skip


def write(project: Path, content: Any) -> Path:
    file = project / "objects" / "candidates.json"
    file.parent.mkdir(exist_ok=True)
    file.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return file


def test_candidates_have_the_message_and_their_pictures(tmp_path: Path) -> None:
    write(tmp_path, STORED)
    not_found = candidates.read_not_found(tmp_path)
    assert not_found.refusals == (candidates.Refusal("Nothing looks enough like 'banana'.", "banana"),)
    picture = tmp_path / "objects" / "_candidates" / "2.png"
    assert not_found.candidates == (candidates.Candidate(2, "banana", 0.21, "view_05.jpg", picture),)


def test_suggestions_and_objects_that_were_meant_are_read_with_the_prompt(tmp_path: Path) -> None:
    refused = {"text": "tepot", "message": "No.", "suggestions": ["teapot"], "objects": ["teapot-2"]}
    (entry,) = STORED["candidates"]
    write(tmp_path, {**STORED, "refused": [refused], "candidates": [{**entry, "object": "vase"}]})
    found = candidates.read_not_found(tmp_path)
    assert found.refusals == (candidates.Refusal("No.", "tepot", ("teapot",), ("teapot-2",)),)
    assert found.candidates[0].object_id == "vase"


def test_model_that_knows_more_words_is_offered_where_a_text_was_refused_by_the_vocabulary(tmp_path: Path) -> None:
    write(tmp_path, STORED)
    assert candidates.read_not_found(tmp_path).offer == ""
    refused = [{"text": "one", "message": "No."}, {"text": "two", "message": "No.", "offer": "clip-vit-b-32"}]
    write(tmp_path, {**STORED, "refused": refused})
    found = candidates.read_not_found(tmp_path)
    assert found.offer == "clip-vit-b-32" and [one.offer for one in found.refusals] == ["", "clip-vit-b-32"]
    assert candidates.read_offer(tmp_path) == found


@pytest.mark.parametrize("stored", [None, STORED])
def test_asking_again_without_an_offer_says_to_ask_for_a_word_first(stored: Any, tmp_path: Path) -> None:
    if stored is not None:
        write(tmp_path, stored)
    with pytest.raises(errors.PromptError, match="No word was refused for which another model is offered"):
        candidates.read_offer(tmp_path)


@pytest.mark.parametrize("picture", ["/etc/passwd", "../../secret.png", ""])
def test_picture_outside_of_the_project_is_refused(picture: str, tmp_path: Path) -> None:
    (entry,) = STORED["candidates"]
    write(tmp_path, {**STORED, "candidates": [{**entry, "picture": picture}]})
    with pytest.raises(errors.FormatError, match="leads out of the folder|it is empty"):
        candidates.read_not_found(tmp_path)


def test_words_outside_the_vocabulary_have_a_message_and_no_candidates(tmp_path: Path) -> None:
    write(tmp_path, {"version": 1, "refused": STORED["refused"]})
    assert candidates.read_not_found(tmp_path).candidates == ()


def test_a_later_search_replaces_the_list_and_dismissing_removes_it(tmp_path: Path) -> None:
    assert candidates.read_not_found(tmp_path) is None
    write(tmp_path, STORED)
    assert len(candidates.read_not_found(tmp_path).candidates) == 1
    write(tmp_path, {"version": 1, "refused": [{"text": "x", "message": "No x."}], "candidates": []})
    assert candidates.read_not_found(tmp_path).refusals == (candidates.Refusal("No x.", "x"),)
    (tmp_path / "project.json").touch()
    candidates.dismiss(tmp_path)
    candidates.dismiss(tmp_path)
    assert candidates.read_not_found(tmp_path) is None


def test_damaged_list_is_a_clear_error(tmp_path: Path) -> None:
    write(tmp_path, "{")
    with pytest.raises(errors.FormatError, match="Delete it and search again"):
        candidates.read_not_found(tmp_path)


def test_a_folder_that_is_no_project_keeps_its_files(tmp_path: Path) -> None:
    file = tmp_path / "objects" / "candidates.json"
    file.parent.mkdir()
    file.write_text("mine", encoding="utf-8")
    with pytest.raises(errors.ProjectError, match="is not a Gaussian Heritage project"):
        candidates.dismiss(tmp_path)
    assert file.read_text(encoding="utf-8") == "mine"
