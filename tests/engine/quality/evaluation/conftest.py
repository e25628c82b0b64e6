"""Evaluations of the blob scene."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from engine.core.events import ignore_events, never_stop
from engine.project.folder import ProjectFolder
from engine.quality.evaluation.isolation import evaluate_project
from engine.quality.evaluation.results import Evaluation
from engine.quality.evaluation.settings import EvaluationSettings
from tests.engine.objects.fakes import FakeDetector, FakeSam, trained_project
from tests.engine.pictures.blob_scene import BlobScene
from tests.engine.quality.evaluation.blob_truth import held_out, write_truth


@pytest.fixture
def project(blobs: BlobScene, tmp_path: Path) -> ProjectFolder:
    return held_out(trained_project(blobs, tmp_path))


@pytest.fixture
def evaluate(blobs: BlobScene, project: ProjectFolder, tmp_path: Path) -> Callable[..., Evaluation]:
    truth = write_truth(blobs, tmp_path / "truth")

    def ask(folder: Path = truth, **given: object) -> Evaluation:
        handed = {name: given.pop(name) for name in ("emit", "should_stop", "layout") if name in given}
        return evaluate_project(
            project, folder, EvaluationSettings(**given), detector_factory=lambda: FakeDetector(blobs),
            sam_factory=lambda: FakeSam(blobs), **{"emit": ignore_events, "should_stop": never_stop, **handed},
        )  # type: ignore[arg-type]  # fmt: skip

    return ask
