"""`plan`: what would be done, left out and taken, before any work; and nothing is written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from engine.cli import main
from engine.system import machine
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


def test_time_of_every_preset_is_told_at_once(photos: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (finished,) = call(capsys, "plan", photos, "--every-preset").of_kind("finished")
    seconds = finished["outputs"]["seconds"]
    assert {"preview", "standard", "best"} <= set(seconds)
    assert all(low < middle < high for low, middle, high in seconds.values())
    assert seconds["preview"][1] < seconds["standard"][1] < seconds["best"][1]
    assert main(["plan", str(photos), "--every-preset"]) == 0
    assert "in 8 of 10 runs" in capsys.readouterr().out


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
