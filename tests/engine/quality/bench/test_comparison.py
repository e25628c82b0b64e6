"""Comparison of presets: the same cameras for all, no preset trained twice, and a time limit that keeps results."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import flip_evaluator
import numpy as np
import pytest
from PIL import Image

from engine.core.errors import SettingsError
from engine.project.folder import ProjectFolder
from engine.quality.bench.comparison import Row, pareto_front, savings
from engine.quality.bench.settings import BenchSettings
from engine.quality.bench.table import markdown
from engine.training.settings import PRESETS
from tests.engine.command_line import Answer, call
from tests.engine.museum import VIEWS, picture, write_cameras

SECOND = "second"


def row(
    name: str, psnr: float | None, cpu: float, *, masks: float | None = None, remark: str = "", seed: int = 0
) -> Row:
    curve = ({"step": 10, "wall_seconds": cpu / 2, "cpu_seconds": cpu, "psnr": psnr, "l1": 0.1},)
    return Row(
        name, seed, 10, 10, 100, psnr, 0.5, 0.1, 0.2, cpu / 2, cpu, None, masks, masks, "test photos", remark, curve
    )


def picture_of(folder: Path) -> np.ndarray:
    return np.asarray(Image.open(folder / "0.jpg"), np.float32) / np.float32(255.0)


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """Five photos; every fourth is a test photo."""
    folder = tmp_path / "photos"
    folder.mkdir()
    for index, view in enumerate(VIEWS):
        picture(view, (192, 144)).save(folder / f"{index}.jpg", quality=95)
    return folder


@pytest.fixture
def scene(photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """Photos, their cameras, and two quick presets."""
    quick = PRESETS["test"].changed(steps=20, held_out_every=4)
    monkeypatch.setitem(PRESETS, "test", quick)
    # Half the size: its errors while training are of other pictures than those of the first.
    monkeypatch.setitem(PRESETS, SECOND, quick.changed(steps=40, max_side=32))
    return photos, write_cameras(tmp_path, {f"{index}.jpg": view for index, view in enumerate(VIEWS)})


def bench(capsys: pytest.CaptureFixture[str], scene: Path, out: Path, *more: object) -> Answer:
    return call(capsys, "bench", scene, "--out", out, "--no-objects", *more)


def test_presets_are_compared_on_the_same_cameras_and_nothing_is_done_twice(
    scene: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photos, cameras = scene
    out, doc = tmp_path / "out", tmp_path / "docs" / "comparison.md"
    command = [photos, out, "--presets", f"test,{SECOND}", "--cameras", cameras, "--doc", doc]
    first = bench(capsys, *command)  # type: ignore[arg-type]
    assert first.code == 0
    assert first.computed == ["photos", "cameras", "training test", f"training {SECOND}"]
    again = bench(capsys, *command)  # type: ignore[arg-type]
    assert again.computed == []
    data = json.loads((out / "bench.json").read_text(encoding="utf-8"))
    assert [row["steps"] for row in data["rows"]] == [20, 40]
    first_row, small = data["rows"]
    assert first_row["psnr"] == pytest.approx(first_row["curve"][-1]["psnr"], abs=0.01)
    assert small["psnr"] != pytest.approx(small["curve"][-1]["psnr"], abs=0.01), "measured at the larger one's size"
    assert all(row["psnr"] > 5 and len(row["curve"]) >= 2 and row["cpu_seconds"] > 0 for row in data["rows"])
    text = doc.read_text(encoding="utf-8")
    assert "python -m engine bench" in text and f"| `{SECOND}` | 40 |" in text and "test photos" in text
    # FLIP of one grey picture against the photos; ours must look more like them than that.
    grey = flip_evaluator.evaluate(picture_of(photos), np.full((144, 192, 3), 0.5, np.float32), "LDR")[1]
    assert all(0.0 < row["flip"] < grey for row in data["rows"]) and "| FLIP |" in text
    assert "its weights are not available here" in text
    assert str(tmp_path) not in text
    assert doc.with_name(f"comparison_{tmp_path.name}.png").read_bytes().startswith(b"\x89PNG")
    assert "| `test` | 20 |" in again.of_kind("finished")[0]["message"]


def test_preset_that_takes_too_long_is_stopped_and_its_row_says_so(
    scene: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(PRESETS, "test", PRESETS["test"].changed(steps=100_000))
    photos, cameras = scene
    command = [photos, tmp_path / "out", "--presets", f"test,{SECOND}", "--cameras", cameras, "--limit", 0.05]
    answer = bench(capsys, *command)  # type: ignore[arg-type]
    assert answer.code == 0
    stopped, done = json.loads((tmp_path / "out" / "bench.json").read_text(encoding="utf-8"))["rows"]
    assert 0 < stopped["steps"] < 100_000 and "stopped at the limit of 0.05 min" in stopped["remark"]
    assert stopped["psnr"] > 5 and stopped["n_gaussians"] > 0
    assert done["steps"] == 40
    # What it may take is counted over all runs.
    again = bench(capsys, *command)  # type: ignore[arg-type]
    assert again.computed == []
    rows = json.loads((tmp_path / "out" / "bench.json").read_text(encoding="utf-8"))["rows"]
    assert rows[0]["steps"] == stopped["steps"]


def test_project_is_only_read_until_its_savings_are_known(
    scene: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photos, cameras = scene
    project = tmp_path / "scene"
    made = call(
        capsys, "reconstruct", photos, "--out", project, "--preset", "test", "--no-objects", "--cameras", cameras
    )
    assert made.code == 0
    before = (project / "gaussians" / "scene.ply").read_bytes()
    answer = bench(capsys, project, tmp_path / "out", "--presets", SECOND)
    assert answer.computed == [f"training {SECOND}"]
    assert (project / "gaussians" / "scene.ply").read_bytes() == before
    assert ProjectFolder.open_existing(project).get("measured_savings") is None
    assert "has its cameras" in bench(capsys, project, tmp_path / "out", "--cameras", cameras).error


def test_unknown_presets_and_a_scene_as_output_are_refused(
    scene: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "preview" in bench(capsys, scene[0], tmp_path / "out", "--presets", "ultra").error
    assert "Choose another folder" in bench(capsys, scene[0], scene[0], "--presets", "test").error
    with pytest.raises(SettingsError, match="limit_minutes"):
        BenchSettings(limit_minutes=0.0)


def test_pareto_front_contains_the_rows_that_no_other_dominates() -> None:
    rows = [row("quick", 20.0, 10.0), row("good", 25.0, 100.0), row("slow", 24.0, 200.0), row("none", None, 1.0)]
    assert pareto_front(rows) == [True, True, False, False]


def test_savings_are_measured_only_between_runs_that_ended() -> None:
    rows = [row("a", 20.0, 60.0, masks=20.0), row("a_full", 20.1, 100.0, masks=60.0), row("b", 20.0, 60.0)]
    (saved,) = savings(rows).values()
    assert saved["training_cpu_seconds"] == 40.0 and saved["mask_cpu_seconds"] == 40.0
    assert saved["share"] == pytest.approx(0.5) and saved["psnr_lost"] == pytest.approx(0.1)
    assert "together 50%" in markdown(rows) and "cost 0.10 dB" in markdown(rows)
    cut = replace(rows[1], remark="stopped at the limit of 5 min")
    assert savings([rows[0], cut]) == {}


def test_cost_of_leaving_out_has_a_standard_error() -> None:
    rows = [row("a", 20.0, 60.0), row("a_full", 20.1, 100.0)]
    rows += [row("a", 20.2, 50.0, seed=1), row("a_full", 20.5, 120.0, seed=1), row("a_full", 30.0, 1.0, seed=2)]
    (saved,) = savings(rows).values()
    assert saved["training_cpu_seconds"] == 55.0
    assert saved["psnr_lost"] == pytest.approx(0.2) and saved["psnr_lost_error"] == pytest.approx(0.1)
    text = markdown(rows)
    assert "cost 0.20 ± 0.10 dB" in text and "| `a_full`, seed 1 |" in text
    assert "seed" not in markdown(rows[:2])


def test_each_preset_is_trained_with_each_random_seed(
    scene: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photos, cameras = scene
    command = [photos, tmp_path / "out", "--presets", "test", "--cameras", cameras, "--random-seeds"]
    assert bench(capsys, *command, "0").computed == ["photos", "cameras", "training test"]  # type: ignore[arg-type]
    assert bench(capsys, *command, "0,7").computed == ["training test 7"]  # type: ignore[arg-type]
    one, other = json.loads((tmp_path / "out" / "bench.json").read_text(encoding="utf-8"))["rows"]
    assert (one["seed"], other["seed"]) == (0, 7) and one["psnr"] != other["psnr"]
    assert "numbers like 0,1,2" in bench(capsys, *command, "a").error  # type: ignore[arg-type]
    assert "seeds" in bench(capsys, *command, "3,3").error  # type: ignore[arg-type]


def test_refused_preset_fails_only_its_row(
    scene: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(PRESETS, SECOND, PRESETS[SECOND].changed(max_gaussians=2_000_000_000))
    photos, cameras = scene
    answer = bench(capsys, photos, tmp_path / "out", "--presets", f"{SECOND},test", "--cameras", cameras)
    assert answer.code == 0 and answer.computed == ["photos", "cameras", "training test"]
    assert "are free" in json.loads((tmp_path / "out" / "bench.json").read_text(encoding="utf-8"))["rows"][0]["remark"]
