"""`render --device`: the graphics card where one works, the processor elsewhere, and a sentence that says which."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.errors import EnvironmentProblem
from engine.rasterizer import gpu as gpu_backend
from engine.rasterizer.gpu import adapters, open_gpu, self_test
from tests.engine.command_line import Answer, call
from tests.engine.objects.fakes import trained_project
from tests.engine.pictures.blob_scene import BlobScene

SENTENCE = "this computer has no graphics card with Vulkan, Metal or DirectX 12"


@pytest.fixture
def scene(blobs: BlobScene, tmp_path: Path) -> Path:
    return trained_project(blobs, tmp_path).path


@pytest.fixture
def no_card(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise EnvironmentProblem(f"{SENTENCE}; use the CPU.")

    monkeypatch.setattr(gpu_backend, "open_gpu", refuse)


def render(capsys: pytest.CaptureFixture[str], scene: Path, out: Path, *more: str) -> Answer:
    return call(capsys, "render", scene, "--view", "view_1.png", "--out", out, "--overwrite", *more)


@pytest.mark.parametrize("what", ["rgb", "depth", "features"])
def test_card_renders_the_picture_of_the_processor(
    what: str, card: gpu_backend.Gpu, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pictures = []
    for device in ("auto", "cpu"):
        answer = render(capsys, scene, tmp_path / f"{device}.png", "--device", device, "--what", what)
        (finished,) = answer.of_kind("finished")
        name = f"{card.name} ({card.backend})" if device == "auto" else "cpu"
        assert finished["outputs"]["device"] == name and f"It was rendered on {name}." in finished["message"]
        pictures.append(np.asarray(Image.open(tmp_path / f"{device}.png")).astype(int))
    difference = np.abs(pictures[0] - pictures[1])
    # Both round float32 values that differ in the last digits; single pixels lie on a threshold of the blending.
    assert np.quantile(difference, 0.999) <= 1 and np.mean(difference > 0) <= 0.01


def test_without_a_card_the_processor_renders_and_the_sentence_says_why(
    no_card: None, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (finished,) = render(capsys, scene, tmp_path / "out.png").of_kind("finished")
    assert finished["message"].endswith(f"It was rendered on cpu, because {SENTENCE}.")
    assert (tmp_path / "out.png").exists()


def test_card_that_is_demanded_and_missing_is_one_sentence(
    no_card: None, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = render(capsys, scene, tmp_path / "out.png", "--device", "gpu")
    assert answer.code != 0 and SENTENCE in answer.error
    assert not (tmp_path / "out.png").exists()


def test_picture_too_large_for_the_card_says_what_to_lower(
    card: gpu_backend.Gpu,
    scene: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("engine.rasterizer.gpu.workspace.free_memory", lambda: 100_000)
    answer = render(capsys, scene, tmp_path / "out.png", "--device", "gpu")
    assert "160 x 120 pixels needs" in answer.error and "render a smaller picture" in answer.error
    (finished,) = render(capsys, scene, tmp_path / "out.png").of_kind("finished")
    assert "It was rendered on cpu, because this picture of 160 x 120 pixels needs" in finished["message"]


def test_python_without_wgpu_says_so_and_uses_the_processor(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Without their caches, so that the card that other tests have opened stays open.
    monkeypatch.setattr(adapters, "_wgpu", adapters._wgpu.__wrapped__)
    monkeypatch.setattr(self_test, "open_adapter", adapters.open_adapter.__wrapped__)
    monkeypatch.setattr(gpu_backend, "open_gpu", open_gpu.__wrapped__)
    monkeypatch.setitem(sys.modules, "wgpu", None)
    (finished,) = render(capsys, scene, tmp_path / "out.png").of_kind("finished")
    assert "rendered on cpu, because this Python has no wgpu for graphics cards" in finished["message"]
    assert "set up the engine again" in render(capsys, scene, tmp_path / "out.png", "--device", "gpu").error
