"""A project is measured by mask, click and word and without a prompt; what a killed run measured stays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from benchmarks.rooms import measuring
from benchmarks.rooms.measuring import measure_project
from benchmarks.rooms.results import figures_of, read_measured
from engine.core.errors import Cancelled, ProjectError
from engine.core.events import ignore_events, never_stop
from engine.project.folder import ProjectFolder
from engine.quality.evaluation import evaluate_project
from engine.quality.evaluation.results import Evaluation
from tests.engine.objects.fakes import FakeDetector, FakeSam, trained_project
from tests.engine.pictures.blob_scene import BLUE, PART_NAMES, RED, TWIN, BlobScene, make_scene
from tests.engine.quality.evaluation.test_isolation import HELD_OUT, write_truth

FIGURES = {"held_out": list(HELD_OUT), "psnr": 27.5, "measured_on": "test photos", "n_gaussians": 100}
NAMES = {RED: "left ball", TWIN: "right ball", BLUE: "small ball"}
PROMPTS = {part: PART_NAMES[part] for part in NAMES}


def finish(project: ProjectFolder, stage: str = "training", key: str = "key", **figures: Any) -> None:
    project.finish_stage(stage, key, wall_seconds=2, cpu_seconds=3, figures={**FIGURES, **figures})


def measure(project: ProjectFolder, blobs: BlobScene) -> dict[str, Any]:
    out = project.path.parent / "measured.json"
    measure_project(
        project.path, project.path.parent / "truth", out, detector_factory=lambda: FakeDetector(blobs),
        sam_factory=lambda: FakeSam(blobs), emit=ignore_events, should_stop=never_stop,
    )  # fmt: skip
    return read_measured(out)


@pytest.fixture(scope="module")
def blobs() -> BlobScene:
    return make_scene()


@pytest.fixture
def make_project(blobs: BlobScene) -> Callable[[Path], ProjectFolder]:
    def make(folder: Path) -> ProjectFolder:
        project = trained_project(blobs, folder)
        for stage in ("photos", "cameras", "masks", "training"):
            finish(project, stage)
        truth = write_truth(blobs, folder / "truth", names=NAMES, prompts=PROMPTS)
        (truth / "absent.json").write_text('["unicorn"]', encoding="utf-8")
        return project

    return make


_evaluated: dict[str, Evaluation] = {}
"""By the kind of prompt: a real evaluation takes seconds, so the tests share one of each kind."""


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The kinds of prompts that were measured."""
    kinds: list[str] = []

    def evaluate(project, truth, settings, **others):  # type: ignore[no-untyped-def]
        kinds.append(settings.prompt_kind)
        if settings.prompt_kind not in _evaluated:
            _evaluated[settings.prompt_kind] = evaluate_project(project, truth, settings, **others)
        return _evaluated[settings.prompt_kind]

    monkeypatch.setattr(measuring, "evaluate_project", evaluate)
    return kinds


@pytest.fixture
def project(make_project: Callable[[Path], ProjectFolder], tmp_path: Path) -> ProjectFolder:
    return make_project(tmp_path)


def test_a_perfect_scene_gets_high_figures(project: ProjectFolder, blobs: BlobScene, asked: list[str]) -> None:
    result = measure(project, blobs)
    assert asked == ["mask", "click", "text", "all"]
    figures = figures_of(result, "better")
    assert figures is not None
    assert (figures.n_objects, figures.n_words, figures.n_absent) == (3, len(set(PROMPTS.values())), 1)
    assert figures.iou is not None and figures.iou > 90
    assert figures.words_found == 100 and figures.refused == 100 and figures.psnr == 27.5
    assert set(result["mask"]) == set(result["click"]) == set(result["text"]) == {"paper", "released", "better"}
    assert set(result["all"]) == {"better"}
    assert figures.click_found == 100 and figures.click_iou is not None and figures.click_iou > 90
    stages = {"photos", "cameras", "masks", "training"}
    assert set(result["seconds"]) == stages | {"by mask", "by click", "by text", "find all"}
    assert result["test_photos"] == list(HELD_OUT)


def test_measuring_continues_with_the_kind_of_prompt_that_was_not_finished(
    project: ProjectFolder, blobs: BlobScene, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop_at_text(project, truth, settings, **others):  # type: ignore[no-untyped-def]
        if settings.prompt_kind == "text":
            raise Cancelled("Stopped.")
        return evaluate(project, truth, settings, **others)

    evaluate = measuring.evaluate_project
    with monkeypatch.context() as stopped:
        stopped.setattr(measuring, "evaluate_project", stop_at_text)
        with pytest.raises(Cancelled):
            measure(project, blobs)
    asked.clear()
    whole = measure(project, blobs)
    assert asked == ["text", "all"]
    assert set(whole["mask"]) == {"paper", "released", "better"}


def test_another_training_is_measured_anew(project: ProjectFolder, blobs: BlobScene, asked: list[str]) -> None:
    measure(project, blobs)
    finish(project, key="of another training")
    asked.clear()
    measure(project, blobs)
    assert asked == ["mask", "click", "text", "all"]


def test_the_psnr_of_training_photos_is_no_test_psnr(
    project: ProjectFolder, blobs: BlobScene, asked: list[str]
) -> None:
    finish(project, measured_on="training photos")
    assert measure(project, blobs)["test_psnr"] is None


def test_an_untrained_project_is_told_in_a_sentence(project: ProjectFolder, blobs: BlobScene) -> None:
    project.forget_stages(["training"])
    with pytest.raises(ProjectError, match="is not trained. Run `python -m benchmarks.rooms reconstruct` first"):
        measure(project, blobs)
