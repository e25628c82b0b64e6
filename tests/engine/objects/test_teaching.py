"""Objects that the user named or accepted teach their words, which other projects then find."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.core.errors import PromptError
from engine.masks import mask_iou
from engine.objects.prompts import ClickPrompt, TextPrompt
from engine.objects.settings import BETTER
from engine.objects.teaching import taught_word
from engine.project.folder import ProjectFolder
from engine.project.objects import ObjectRecord, list_objects, load_membership, rename_object
from engine.project.own_words import Example, OwnWords
from tests.engine.objects.fakes import segmenter_of, trained_project
from tests.engine.pictures.blob_scene import BLUE, PART_NAMES, BlobScene

SMALL = replace(BETTER, photo_side=160, render_side=160)


@pytest.fixture
def own(tmp_path: Path) -> OwnWords:
    return OwnWords(tmp_path / "own_words.json")


def record(name: str, prompt: dict[str, Any]) -> ObjectRecord:
    return ObjectRecord("id", name, prompt, 0.5, 1.0, 1.0, 3, 10)


@pytest.mark.parametrize(
    ("name", "prompt", "word"),
    [
        ("reliquary", {"kind": "click"}, "reliquary"),
        ("Reliquary-2", {"kind": "mask"}, "Reliquary"),
        ("object", {"kind": "click"}, ""),
        ("object-3", {"kind": "box"}, ""),
        ("amphora", {"kind": "text", "text": "amphora"}, ""),
        ("amphora-2", {"kind": "text", "text": "Amphoras"}, ""),
        ("pelike", {"kind": "text", "text": "amphora"}, "pelike"),
        ("amphora", {"kind": "text", "text": "amphora", "accepted": True}, "amphora"),
        ("left vase", {"kind": "text", "text": "left vase", "accepted": True}, "vase"),
        ("vase", {"kind": "all", "name": "vase"}, ""),
        ("object 4", {"kind": "all", "name": "object 4"}, ""),
        ("lekythos", {"kind": "all", "name": "vase"}, "lekythos"),
        ("vase", {"kind": "all"}, ""),  # of a version that did not store what it suggested
        ("background", {"kind": "background"}, ""),
        ("...", {"kind": "click"}, ""),
    ],
)
def test_only_names_that_the_user_gave_or_accepted_teach(name: str, prompt: dict[str, Any], word: str) -> None:
    assert taught_word(record(name, prompt)) == word


def ask(blobs: BlobScene, project: ProjectFolder, text: str, own: OwnWords | None) -> list[ObjectRecord]:
    return segmenter_of(project, blobs, SMALL, own_words=own).segment_texts([text], None)[0]


def test_clicked_and_named_object_is_found_by_its_word_in_another_project_that_learns(
    blobs: BlobScene, own: OwnWords, tmp_path: Path
) -> None:
    first, second = (trained_project(blobs, tmp_path / name) for name in ("first", "second"))
    prompt = ClickPrompt("view_2.png", *blobs.center_of(BLUE, "view_2.png"))
    segmenter_of(first, blobs, SMALL, own_words=own).segment(prompt, "orb")
    assert [one.word for one in own.examples()] == ["orb"]
    (found,) = ask(blobs, second, "the orbs", own)
    truth, members = blobs.part == BLUE, load_membership(second.path, found.id) >= 0.5
    assert mask_iou(members, truth) > 0.95
    with pytest.raises(PromptError, match="not known"):
        ask(blobs, second, "orb", None)


def test_project_that_does_not_learn_teaches_nothing(blobs: BlobScene, own: OwnWords, tmp_path: Path) -> None:
    project = trained_project(blobs, tmp_path)
    segmenter_of(project, blobs, SMALL).segment(ClickPrompt("view_2.png", *blobs.center_of(BLUE, "view_2.png")), "orb")
    assert not own.file.exists()


def test_renamed_object_teaches_its_new_name_when_something_is_asked_next(
    blobs: BlobScene, own: OwnWords, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = trained_project(blobs, tmp_path)
    (blue,) = ask(blobs, project, "blue ball", own)
    assert own.examples() == [], "what a word found by itself teaches nothing"
    rename_object(project.path, blue.id, "marble")
    assert [one.id for one in ask(blobs, project, "marble", own)] == [blue.id]
    assert [one.word for one in own.examples()] == ["marble"]
    with monkeypatch.context() as patched:
        patched.setattr("engine.objects.looks.describe_members", None)  # nothing is taught twice
        ask(blobs, project, "red ball", own)
    rename_object(project.path, blue.id, "agate")
    ask(blobs, project, "red ball", own)
    assert [one.word for one in own.examples()] == ["agate"]


def test_accepted_picture_teaches_its_word(blobs: BlobScene, own: OwnWords, tmp_path: Path) -> None:
    project = trained_project(blobs, tmp_path)
    with pytest.raises(PromptError):
        ask(blobs, project, "astrolabe", own)

    def none() -> Any:
        raise AssertionError("a model was loaded")

    segmenter = segmenter_of(project, blobs, SMALL, own_words=own, detector_factory=none)
    (one,) = segmenter.accept_candidate(1, None)
    assert one.name == "astrolabe" and [example.word for example in own.examples()] == ["astrolabe"]
    assert [found.id for found in ask(blobs, project, "astrolabe", own)] == [one.id]


def test_word_that_was_taught_is_refused_where_nothing_looks_like_it(
    blobs: BlobScene, own: OwnWords, tmp_path: Path
) -> None:
    project = trained_project(blobs, tmp_path)
    unlike = np.full(1 + max(PART_NAMES), 0.05, np.float32)
    unlike[0] = 1  # the floor, which is no object
    own.add([Example("ghost ship", "a", "b", "fake", "fake 1", "2026", unlike)])
    with pytest.raises(PromptError, match="looks enough like"):
        ask(blobs, project, "ghost ship", own)
    assert list_objects(project.path) == []


def test_examples_of_another_version_of_the_detector_are_not_compared(own: OwnWords) -> None:
    own.add([Example("orb", "a", "b", "fake", "fake 0", "2026", np.ones(4, np.float32))])
    assert [len(rows) for rows in own.means_of("orb", "fake 1")] == [0, 0]
    assert [len(rows) for rows in own.means_of("orb", "fake 0")] == [1, 0]
    assert [len(rows) for rows in own.means_of("ball", "fake 0")] == [0, 1]


def test_spatial_words_choose_among_what_a_taught_word_finds(blobs: BlobScene, own: OwnWords, tmp_path: Path) -> None:
    project = trained_project(blobs, tmp_path)
    prompt = ClickPrompt("view_2.png", *blobs.center_of(BLUE, "view_2.png"))
    segmenter = segmenter_of(project, blobs, SMALL, own_words=own)
    (known,) = segmenter.segment(prompt, "orb")
    found = segmenter.segment(TextPrompt("left orb"), "left orb")
    assert len(found) == 1 and known.id
