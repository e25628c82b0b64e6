"""`plan`: what would be done, left out and taken, before any work; and nothing is written."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from engine.cli.main import main
from engine.core.system import machine
from engine.training.settings import PRESET_LIST
from tests.conftest import ROOT
from tests.engine.command_line import call
from tests.engine.museum import VIEWS, write_cameras, write_photos


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    return write_photos(tmp_path / "photos")


def test_person_reads_what_is_planned_and_what_is_left_out(photos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(photos)]) == 0
    said = capsys.readouterr().out
    for words in (
        "5 photos, the largest 192 x 144; preset standard", "every pair of photos is matched: 10", "Left out:",
        "test photos 1, to measure the error", "together", "GB are free", "20 to 60 around an object",
    ):  # fmt: skip
        assert words in said, words
    assert sorted(path.suffix for path in photos.iterdir()) == [".jpg"] * 5


def test_program_reads_the_same_as_json(photos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(photos), "--preset", "preview", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["plan"]["preset"] == "preview" and said["plan"]["n_photos"] == 5
    low, middle, high = said["forecast"]["seconds"]
    assert 0 < low < middle < high
    assert {stage["stage"] for stage in said["forecast"]["stages"]} >= {"photos", "cameras", "masks", "training"}


def test_every_offered_preset_has_a_time_and_a_sentence(photos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = call(capsys, "plan", photos, "--every-preset")
    (finished,) = answer.of_kind("finished")
    presets = finished["outputs"]["presets"]
    assert [preset["name"] for preset in presets] == [one.name for one in PRESET_LIST if one.offered]
    seconds = [preset["forecast"]["seconds"][1] for preset in presets]
    assert seconds == sorted(seconds) and seconds[0] < seconds[-1]
    for one in PRESET_LIST:
        assert (one.description in finished["message"]) == one.offered


def test_dialog_does_not_wait_for_what_trains(photos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "plan", photos, "--every-preset").code == 0  # measures this machine where no test has yet
    code = (
        "import sys; from engine.cli.main import main; assert main(sys.argv[1:]) == 0; "
        "assert not {'torch', 'pycolmap', 'onnxruntime', 'cv2', 'wgpu'} & set(sys.modules), sorted(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code, "plan", str(photos), "--every-preset"], check=True, cwd=ROOT)


def test_wishes_change_the_plan(photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = write_cameras(tmp_path, {f"view_{view:02}.jpg": view for view in VIEWS})
    answer = call(capsys, "plan", photos, "--no-objects", "--cameras", model)
    (finished,) = answer.of_kind("finished")
    plan = finished["outputs"]["plan"]
    assert not plan["features"] and plan["n_mask_photos"] == 0 and plan["pairs"] == "none"
    assert {"structure from motion", "masks and segmentation features"} <= {item["what"] for item in plan["left_out"]}


def test_too_little_memory_is_refused_before_any_work(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "free_memory", lambda: 900_000_000)
    model = write_cameras(tmp_path, {f"view_{view:02}.jpg": view for view in VIEWS})
    planned = call(capsys, "plan", photos, "--preset", "paper", "--no-objects", "--cameras", model)
    assert planned.code == 1
    assert "0.9 GB are free" in planned.error and "--preset" in planned.error
    command = ["reconstruct", photos, "--out", tmp_path / "scene", "--preset", "paper", "--no-objects"]
    refused = call(capsys, *command, "--cameras", model)
    assert refused.code == 1 and refused.error == planned.error
    assert refused.computed == ["photos"]


def test_missing_photos_and_camera_models_are_one_sentence(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "does not exist" in call(capsys, "plan", tmp_path / "nowhere").error
    assert "does not exist" in call(capsys, "plan", photos, "--cameras", tmp_path / "none.json").error


def test_more_gaussians_are_for_graphics_cards(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sizes = ("--max-gaussians", "3000000", "--max-side", "1600", "--device", "cpu")
    for command in (["plan", photos], ["reconstruct", photos, "--out", tmp_path / "scene"]):
        refused = call(capsys, *command, *sizes)
        assert refused.code == 2
        assert "--max-gaussians 3000000 --max-side 1600 needs training on a graphics card" in refused.error
