"""`ask`: words can be asked of a scene while it is trained, and the project stays as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from engine.core.files import file_sha256
from engine.project.folder import ProjectFolder
from engine.training.adam import AdamState
from engine.training.checkpoint import RunState, write_checkpoint
from engine.training.held_out import CurvePoint
from engine.training.parameters import Parameters
from tests.engine.command_line import call
from tests.engine.objects.fakes import FakeDetector, FakeSam
from tests.engine.pictures.blob_scene import BlobScene

KEY = "0123456789abcdef"


@pytest.fixture(autouse=True)
def _models(blobs: BlobScene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("engine.objects.grounding.default.load_default_detector", lambda: FakeDetector(blobs))
    monkeypatch.setattr("engine.masks.sam.load_sam", lambda name: FakeSam(blobs))


@pytest.fixture
def training(scene: Path, blobs: BlobScene) -> Path:
    """A project in which a run works that has written a checkpoint; it has no scene yet."""
    for file in (scene / "gaussians").iterdir():
        file.unlink()
    with ProjectFolder.open_existing(scene) as project:
        project.put("begun", ["training", KEY])
    parameters = Parameters.from_gaussians(blobs.gaussians, sh_degree=0, features=True)
    exposure = torch.zeros(3, 3)
    state = RunState(parameters, exposure, AdamState.zeros_like(exposure), step=500)
    state.curve.append(CurvePoint(500, 1.0, 1.0, 20.0, 0.5, 0.1, len(parameters)))
    write_checkpoint(scene / "checkpoints" / KEY[:12], KEY, state)
    return scene


def _files(project: Path) -> dict[str, str]:
    return {str(file.relative_to(project)): file_sha256(file) for file in project.rglob("*") if file.is_file()}


def test_words_are_answered_while_a_run_works_and_the_project_stays_as_it_is(
    training: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with ProjectFolder.open_existing(training):  # as the run holds it
        before = _files(training)
        answer = call(capsys, "ask", training, "--prompt", "blue ball; unheard", "--out", tmp_path / "answers")
        assert _files(training) == before
    assert answer.code == 0
    (finished,) = answer.of_kind("finished")
    outputs = finished["outputs"]
    assert outputs["step"] == 500 and list(outputs["refused"]) == ["unheard"]
    (found,) = outputs["found"]
    assert found["text"] == "blue ball" and finished["message"].startswith("After step 500 of the training")
    picture = np.asarray(Image.open(found["picture"]).convert("RGB")).astype(int)
    brightest = picture[picture.sum(axis=2) > 0.8 * picture.sum(axis=2).max()].mean(axis=0)
    # What is meant is as bright as in the photo, its surroundings are half as bright.
    assert brightest[2] > brightest[0]


def test_scene_without_a_shape_one_that_is_trained_and_one_that_nobody_trains_are_told_apart(
    training: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ("ask", training, "--prompt", "blue ball", "--out", tmp_path / "answers")
    with ProjectFolder.open_existing(training) as project:
        project.put("begun", ["training", KEY[::-1]])
        assert "no shape yet" in call(capsys, *asked).error
        project.put("begun", ["masks", KEY])
        assert "is not being trained" in call(capsys, *asked).error
        project.put("begun", ["training", "../../else"])
        assert "leads out of the folder" in call(capsys, *asked).error
        project.put("begun", ["training", KEY])
        project.finish_stage("training", KEY, wall_seconds=1.0, cpu_seconds=1.0, figures={})
        assert "is trained now. Isolate its objects" in call(capsys, *asked).error
    assert not (tmp_path / "answers").exists()


def test_words_of_which_none_is_found_are_an_error_with_the_reasons(
    training: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = call(capsys, "ask", training, "--prompt", "unheard", "--out", tmp_path / "answers")
    assert answer.code == 3 and "'unheard' is not known" in answer.error
