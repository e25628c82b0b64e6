"""Words are measured by what their first result shows, absent things by being refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.core.events import never_stop
from engine.objects.found import Levels
from engine.objects.photos import Photos
from engine.objects.segment import find_objects
from engine.objects.settings import BETTER
from engine.quality.evaluation.ceiling import words_of_true_masks
from engine.quality.evaluation.ground_truth import read_ground_truth
from engine.quality.evaluation.results import Evaluation
from engine.quality.evaluation.summary import n_ranked_first, summarise
from engine.quality.evaluation.table import markdown
from tests.engine.objects.fakes import FakeDetector, FakeSam
from tests.engine.pictures.blob_scene import BLUE, RED, TWIN, BlobScene
from tests.engine.quality.evaluation.blob_truth import write_truth

TWINS = {RED: "red ball", TWIN: "red ball", BLUE: "blue ball"}


def test_word_is_found_when_its_first_result_is_the_object(evaluate, blobs: BlobScene, tmp_path: Path) -> None:
    truth = write_truth(blobs, tmp_path / "twins", prompts=TWINS, absent=("ghost", "unicorn"))
    found: Evaluation = evaluate(truth, prompt_kind="text", presets=("paper", "better"))
    asked = [(word.prompt, word.method) for word in found.words]
    assert asked == [(w, m) for w in ("red ball", "blue ball", "ghost", "unicorn") for m in ("paper", "better")]
    for word in found.words[:4]:
        assert word.found and word.iou > 0.9 and word.boundary_iou > 0.8 and not word.absent, word
        assert word.shows in ("red ball", "other red ball", "blue ball") and word.score > 0.3
    for word in found.words[4:]:
        assert word.absent and word.n_results == 0 and math.isnan(word.iou) and word.shows == "" and not word.found
    assert "'unicorn' is not known" in found.words[-1].remark
    for figures in summarise(found):
        assert (figures.n_found, figures.n_asked, figures.n_refused, figures.n_absent) == (2, 2, 2, 2)
        own = [word for word in found.words if word.method == figures.method]
        assert figures.iou == pytest.approx((own[0].iou + own[1].iou) / 2)
        # The first prompt loads the models.
        assert figures.seconds_worst == max(word.seconds for word in own[1:])
        assert figures.cpu_seconds_median == np.median([word.cpu_seconds for word in own[1:]])
    table = markdown(found)
    assert f"| blue ball | blue ball {100 * found.words[2].iou:.1f} |" in table
    assert "Absent words: ghost, unicorn." in table
    assert "| paper | none |\n| better | none |" in table


def first_is(part: int, blobs: BlobScene) -> Callable[..., Any]:
    """A search whose first result is a part of the scene, whatever was asked for."""

    def search(*arguments: Any, **others: Any) -> Any:
        found = find_objects(*arguments, **others)
        wrong = replace(found[0], levels=Levels(((blobs.part == part).astype(np.float32),)), score=0.9)
        return [wrong, *found]

    return search


def test_first_result_that_is_another_object_is_not_found_and_counts_its_own_iou(
    evaluate, blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("engine.quality.evaluation.trained_scene.find_objects", first_is(RED, blobs))
    truth = write_truth(blobs, tmp_path / "twins", prompts=TWINS)
    found = evaluate(truth, prompt_kind="text", presets=("better",))
    red, blue = found.words
    # Of equal objects the one that the first result matches best counts.
    assert red.found and red.iou > 0.9 and red.shows == "red ball"
    assert not blue.found and blue.iou < 0.1 and blue.shows == "red ball" and blue.n_results == 2
    (figures,) = summarise(found)
    assert (figures.n_found, figures.n_asked) == (1, 2) and figures.iou == pytest.approx((red.iou + blue.iou) / 2)
    assert "| blue ball | **red ball " in markdown(found)


def test_accepted_absent_word_is_told_with_what_it_showed(
    evaluate, blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def search(context: Any, prompt: Any, *arguments: Any, **others: Any) -> Any:
        asked = type(prompt)("blue ball") if prompt.text == "ghost" else prompt
        return find_objects(context, asked, *arguments, **others)

    monkeypatch.setattr("engine.quality.evaluation.trained_scene.find_objects", search)
    truth = write_truth(blobs, tmp_path / "ghosts", absent=("ghost",), names={BLUE: "blue ball"})
    found = evaluate(truth, prompt_kind="text", presets=("better",))
    (figures,) = summarise(found)
    assert (figures.n_refused, figures.n_absent) == (0, 1)
    assert "| better | ghost (blue ball) |" in markdown(found)


def test_refused_word_counts_0(evaluate, blobs: BlobScene, tmp_path: Path) -> None:
    truth = write_truth(blobs, tmp_path / "texts", names={BLUE: "blue ball", RED: "ghost"})
    found = evaluate(truth, prompt_kind="text", presets=("better",))
    ghost = next(word for word in found.words if word.prompt == "ghost")
    assert (ghost.iou, ghost.boundary_iou, ghost.n_results, ghost.found) == (0.0, 0.0, 0, False)
    (figures,) = summarise(found)
    assert (figures.n_found, figures.n_asked) == (1, 2)
    assert figures.iou == pytest.approx(max(word.iou for word in found.words) / 2)
    assert ghost.is_offered and ghost.offered_iou > 0.9
    assert "Refused words whose object is among the pictures that are offered: better 1 of 1." in markdown(found)


def test_absent_things_are_not_asked_for_when_objects_are_chosen(evaluate, blobs: BlobScene, tmp_path: Path) -> None:
    truth = write_truth(blobs, tmp_path / "chosen", absent=("ghost",))
    found = evaluate(truth, prompt_kind="text", presets=("paper",), objects=("blue ball",))
    assert [word.prompt for word in found.words] == ["blue ball"]


class Mistaken(FakeDetector):
    """A detector that scores the blue ball higher as a ghost."""

    def score_descriptions(self, described, prompt):  # type: ignore[no-untyped-def]
        if prompt == "ghost":
            return [1.5 * score for score in super().score_descriptions(described, "blue ball")]
        return super().score_descriptions(described, prompt)


def test_words_of_true_masks_are_those_that_the_detector_scores_highest(
    blobs: BlobScene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_truth(blobs, tmp_path / "truth", prompts=TWINS, absent=("ghost",))
    truth = read_ground_truth(folder, list(blobs.labels))
    photos = Photos(blobs.write_photos(tmp_path / "photos"), BETTER, lambda: FakeSam(blobs))  # type: ignore[arg-type,return-value]
    cameras = {camera.photo: camera for camera in blobs.cameras.cameras[:5]}
    looked_at: set[str] = set()
    pixels_of = Photos.pixels

    def noted(self: Photos, camera: Any) -> Any:
        looked_at.add(camera.photo)
        return pixels_of(self, camera)

    monkeypatch.setattr(Photos, "pixels", noted)

    def words(detector: FakeDetector, objects: tuple[str, ...] = truth.objects, **others: Any) -> dict[str, str] | None:
        given = {"cameras": cameras, "n_photos": 3, "should_stop": never_stop, **others}
        return words_of_true_masks(truth, objects, photos=photos, detector=detector, **given)  # type: ignore[arg-type]

    assert words(FakeDetector(blobs)) == {"red ball": "red ball", "blue ball": "blue ball"}
    assert looked_at <= set(cameras)
    assert words(Mistaken(blobs)) == {"red ball": "red ball", "blue ball": "ghost"}
    assert words(FakeDetector(blobs), ("blue ball",)) == {"blue ball": "blue ball"}
    assert words(FakeDetector(blobs), cameras={}) is None


def test_ceiling_is_told_beside_the_words(evaluate, blobs: BlobScene, tmp_path: Path) -> None:
    truth = write_truth(blobs, tmp_path / "twins", names={BLUE: "blue ball", RED: "ghost"})
    found = evaluate(truth, prompt_kind="text", presets=("paper",))
    assert found.ceiling == {"blue ball": "blue ball", "ghost": ""} and n_ranked_first(found) == 1
    assert "Words ranked first on the true masks: 1 of 2; not: ghost (nothing)" in markdown(found)
    everywhere = evaluate(truth, prompt_kind="mask", presets=("paper",))
    assert everywhere.ceiling is None and n_ranked_first(everywhere) is None
