"""The user's own vocabulary: taught, forgotten, exported and imported; a damaged one is a sentence."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.core.errors import FormatError, ProjectInUse, PromptError
from engine.project import own_words
from engine.project.folder import ProjectFolder, hold_mark
from engine.project.own_words import Example, OwnWords, learns_words, same_word, set_learning


def example(word: str, source: str = "a", value: float = 0.5, fingerprint: str = "f") -> Example:
    vector = np.array([value, -0.25, 1.0], np.float32)
    return Example(word, source, "state", "offline-vocabulary", fingerprint, "2026-11-29T12:00:00+00:00", vector)


@pytest.fixture
def own(tmp_path: Path) -> OwnWords:
    return OwnWords(tmp_path / "own_words.json")


def test_vocabulary_that_was_never_taught_is_empty(own: OwnWords) -> None:
    assert own.examples() == [] and not own.file.exists()


def test_taught_examples_are_read_as_they_were_by_version_of_the_detector(own: OwnWords) -> None:
    own.add([example("Reliquary"), example("mask", "b", fingerprint="other")])
    (one,) = own.examples("f")
    assert (one.word, one.source, one.state) == ("Reliquary", "a", "state")
    np.testing.assert_array_equal(one.vector, [0.5, -0.25, 1.0])
    assert [one.word for one in OwnWords(own.file).examples()] == ["Reliquary", "mask"]


def test_mean_of_a_word_is_over_its_examples_in_any_case_and_number(own: OwnWords) -> None:
    own.add(
        [example("Mask", "a", 0.0), example("masks", "b", 1.0), example("bell", "c"), example("x", "d", 1, "other")]
    )
    ours, others = own.means_of("the mask", "f")
    np.testing.assert_array_equal(ours, [[0.5, -0.25, 1.0]])
    assert len(others) == 1
    ours, others = own.means_of("gong", "f")
    assert (ours.shape, others.shape) == ((0, 3), (2, 3))
    assert [rows.shape[0] for rows in own.means_of("mask", "unknown")] == [0, 0]


def test_object_that_was_renamed_teaches_its_new_word_alone(own: OwnWords) -> None:
    own.add([example("vase"), example("vase", "b")])
    own.add([example("amphora", "a", 0.75)])
    assert [(one.source, one.word) for one in own.examples()] == [("b", "vase"), ("a", "amphora")]


def test_word_is_forgotten_in_any_case_and_number_with_all_its_examples(own: OwnWords) -> None:
    own.add([example("Amphora"), example("amphoras", "b"), example("mask", "c")])
    assert own.forget("the AMPHORAS") == 2
    assert [one.word for one in own.examples()] == ["mask"]
    with pytest.raises(PromptError, match=r"does not have 'masc'\. It has mask\."):
        own.forget("masc")
    own.forget("mask")
    with pytest.raises(PromptError, match="It is empty"):
        own.forget("mask")


def test_exported_words_are_imported_beside_those_that_are_there(own: OwnWords, tmp_path: Path) -> None:
    own.add([example("vase"), example("mask", "b")])
    assert own.export(tmp_path / "copy.json") == 2
    other = OwnWords(tmp_path / "other" / "own_words.json")
    other.file.parent.mkdir()
    other.add([example("bell", "c")])
    assert other.import_from(tmp_path / "copy.json") == 2
    assert other.import_from(tmp_path / "copy.json") == 2, "imported twice, nothing is there twice"
    assert sorted(one.word for one in other.examples()) == ["bell", "mask", "vase"]


def test_words_of_another_width_do_not_spoil_the_vocabulary(own: OwnWords, tmp_path: Path) -> None:
    own.add([example("vase")])
    before = own.file.read_bytes()
    other = OwnWords(tmp_path / "other.json")
    wide = example("mask", "b")
    other.add([Example(**{**vars(wide), "vector": np.ones(5, np.float32)})])
    with pytest.raises(FormatError, match="does not fit the others"):
        own.import_from(other.file)
    assert own.file.read_bytes() == before


@pytest.mark.parametrize(
    "damage",
    [
        lambda entry: {**entry, "vector": "!"},
        lambda entry: {**entry, "vector": "é"},
        lambda entry: {**entry, "vector": ""},
        lambda entry: {**entry, "vector": "AHw="},  # infinity
        lambda entry: {**entry, "vector": "AAA"},
        lambda entry: {**entry, "word": " "},
        lambda entry: {**entry, "word": "v" * 101},
        lambda entry: {**entry, "word": 3},
        lambda entry: {name: value for name, value in entry.items() if name != "source"},
    ],
)
def test_damaged_vocabulary_is_named_and_kept(damage: Callable[[Any], Any], own: OwnWords) -> None:
    own.add([example("vase")])
    data = json.loads(own.file.read_text(encoding="utf-8"))
    data["examples"] = [damage(data["examples"][0])]
    own.file.write_text(json.dumps(data), encoding="utf-8")
    damaged = own.file.read_bytes()
    for use in (own.examples, lambda: own.add([example("mask", "b")]), lambda: own.forget("vase")):
        with pytest.raises(FormatError, match="own_words.json.*Import a copy of it, or delete it"):
            use()
    assert own.file.read_bytes() == damaged


def test_more_examples_than_are_kept_are_refused(own: OwnWords, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_words, "_MAX_EXAMPLES", 2)
    own.add([example("vase"), example("vase", "b")])
    own.add([example("mask", "b")])  # in the place of one that is there
    with pytest.raises(PromptError, match="Forget words that you do not need"):
        own.add([example("bell", "c")])
    assert len(own.examples()) == 2


def test_vocabulary_that_another_job_writes_is_waited_for(own: OwnWords, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_words, "_WAIT_SECONDS", 0.0)
    lock = own.file.with_name("own_words.json.lock")
    with hold_mark(lock), pytest.raises(ProjectInUse, match="Another job is writing"):
        own.add([example("vase")])
    own.add([example("vase")])
    assert len(own.examples()) == 1


def test_case_article_and_number_make_no_other_word() -> None:
    assert same_word("Amphora", "an amphora") and same_word("masks", "mask") and same_word("statuettes", "Statuette")
    assert not same_word("mask", "masque") and not same_word("", "")


def test_project_learns_only_after_the_user_said_so(tmp_path: Path) -> None:
    with ProjectFolder.create(tmp_path / "scene") as project:
        assert not learns_words(project)
        set_learning(project, True)
        assert learns_words(ProjectFolder.open_existing(project.path))
        set_learning(project, False)
    assert not learns_words(ProjectFolder.open_existing(project.path))
