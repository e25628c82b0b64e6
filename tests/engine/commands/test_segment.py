"""`segment`: any name is a name, unclear prompts are refused with what to do, and nothing is overwritten."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.objects.storage import list_objects
from tests.engine.command_line import call
from tests.engine.models.weights import fetched
from tests.engine.objects.fakes import trained_project
from tests.engine.pictures.blob_scene import BLUE, BlobScene


@pytest.fixture
def scene(blobs: BlobScene, tmp_path: Path) -> Path:
    return trained_project(blobs, tmp_path).path


@pytest.fixture
def blue(blobs: BlobScene, tmp_path: Path) -> str:
    """The mask of the blue ball as `--seed-mask` wants it: needs no model."""
    mask = (blobs.labels["view_1.png"] == BLUE).astype(np.uint8) * 255
    Image.fromarray(mask).save(tmp_path / "blue.png")
    return f"view_1.png={tmp_path / 'blue.png'}"


@pytest.mark.parametrize(
    ("name", "folder"),
    [("altar/left", "altar-left"), ("..", "object"), ("", "object"), ("CON", "object-con"), ("vase\\ü", "vase-ü")],
)
def test_any_name_is_kept_and_found_again_in_a_folder_every_system_takes(
    name: str, folder: str, scene: Path, blue: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = call(capsys, "segment", scene, "--seed-mask", blue, "--name", name)
    assert answer.code == 0
    assert answer.of_kind("finished")[0]["outputs"] == {"objects": [folder]}
    assert [path.name for path in (scene / "objects").iterdir()] == [folder]
    (record,) = list_objects(scene)
    assert record.name == (name or "object")
    out = tmp_path / "out.ply"
    assert call(capsys, "export", scene, "--object", record.name, "--format", "ply", "--out", out).code == 0


def test_same_name_twice_makes_a_second_object(scene: Path, blue: str, capsys: pytest.CaptureFixture[str]) -> None:
    for _ in range(2):
        assert call(capsys, "segment", scene, "--seed-mask", blue, "--name", "ball").code == 0
    assert [record.name for record in list_objects(scene)] == ["ball", "ball-2"]


def test_empty_prompt_says_what_to_type(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = call(capsys, "segment", scene, "--prompt", " ")
    assert answer.code == 3
    assert "The prompt is empty" in answer.error
    assert list_objects(scene) == []


def test_unknown_prompt_names_the_nearest_words(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fetched("efficientnet-lite2", "minilm", "minilm-tokenizer")
    answer = call(capsys, "segment", scene, "--prompt", "flux capacitor")
    assert answer.code == 3
    assert "nearest words are" in answer.error
    assert list_objects(scene) == []


@pytest.mark.parametrize("prompt", [("--prompt", "vase"), ("--click", "view_1.png=80,60")], ids=["text", "click"])
def test_missing_model_file_names_the_command(
    prompt: tuple[str, str], scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setenv("GAUSSIAN_HERITAGE_CACHE", str(tmp_path / "cache"))
    assert "is missing. Run: python -m engine models fetch" in call(capsys, "segment", scene, *prompt).error


@pytest.mark.parametrize("photo", ["view_99.png", "../view_1.png"])
def test_photo_that_is_not_of_the_scene_is_named(photo: str, scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert photo in call(capsys, "segment", scene, "--click", f"{photo}=5,5").error


def test_photos_that_moved_away_are_named(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (scene.parent / "photos").rename(scene.parent / "elsewhere")
    error = call(capsys, "segment", scene, "--click", "view_1.png=80,60").error
    assert "view_1.png" in error
