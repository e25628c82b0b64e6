"""The machine is measured once, every run improves the calibration, and a damaged file stops no run."""

from __future__ import annotations

import json
import logging
import math
from dataclasses import replace
from pathlib import Path

import pytest

from engine.core.events import Event, Progress
from engine.core.system import Machine
from engine.pipeline.planning.benchmark import calibrate, measure_speed
from engine.pipeline.planning.calibration import REFERENCE, Benchmark, Calibration, Correction, load_calibration
from engine.pipeline.planning.decisions import training_settings
from engine.pipeline.planning.forecast import forecast_work
from engine.pipeline.planning.outcome import update_calibration
from engine.project.folder import ProjectFolder

from .scenes import work

MACHINE = Machine(2, 16_000_000_000, "cpu", "test")


class Speed:
    """Replaces the benchmark and counts its runs."""

    def __init__(self) -> None:
        self.made = 0

    def __call__(self) -> Benchmark:
        self.made += 1
        return replace(REFERENCE, training_step=0.05)


def load(file: Path, speed: Speed, *, machine: Machine = MACHINE, rasterizer: str = "one") -> Calibration:
    return load_calibration(machine, rasterizer=rasterizer, measure=speed, file=file)


def test_machine_is_measured_once_and_again_when_it_or_the_rasterizer_changed(tmp_path: Path) -> None:
    file, speed = tmp_path / "cache" / "calibration.json", Speed()
    load(file, speed)
    again = load(file, speed)
    assert speed.made == 1
    assert again.benchmark == replace(REFERENCE, training_step=0.05, rasterizer="one")
    again.add_outcome("masks", "cpu", formula=10.0, actual=20.0)
    again.save()
    newer = load(file, speed, rasterizer="two")
    assert speed.made == 2
    assert newer.correction("masks", "cpu").n == 1, "outcomes of runs stay valid with a new rasterizer"
    load(file, speed, machine=replace(MACHINE, name="another"))
    assert speed.made == 3
    assert load(file, speed, rasterizer="two").correction("masks", "cpu").n == 1
    assert speed.made == 3


@pytest.mark.parametrize(
    "damage",
    [
        "", "{", "[]", "[" * 100_000, '{"version": 9}', '{"version": 2}', '{"version": 2, "machines": []}',
        '{"version": 2, "machines": {"x": 1e999}}',
        *({"training_step": "fast"}, {"training_step": 0}, {"features": 1e300}, {"sam_encode": -1}, {"libraries": 1.5}),
    ],
    ids=[
        "empty", "cut", "list", "nested", "version", "no machines", "machines", "infinite",
        "text", "zero", "huge", "negative", "half a byte",
    ],
)  # fmt: skip
def test_damaged_file_is_replaced_and_that_is_logged(
    damage: str | dict[str, object], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file, speed = tmp_path / "calibration.json", Speed()
    load(file, speed)
    if isinstance(damage, dict):
        data = json.loads(file.read_text())
        for machine in data["machines"].values():
            machine["benchmark"].update(damage)
        damage = json.dumps(data)
    file.write_text(damage)
    with caplog.at_level(logging.WARNING):
        assert load(file, speed).benchmark is not None
    assert speed.made == 2 and "measured again" in caplog.text
    assert load(file, speed).benchmark is not None and speed.made == 2


def test_damaged_values_of_another_machine_are_dropped(tmp_path: Path) -> None:
    file, speed = tmp_path / "calibration.json", Speed()
    load(file, speed)
    text = file.read_text().replace('"machines": {', '"machines": {"other": {"n_runs": "many"},')
    file.write_text(text)
    calibration = load(file, speed)
    assert speed.made == 1
    calibration.save()
    assert "other" not in json.loads(file.read_text())["machines"]


def test_correction_out_of_range_is_measured_again(tmp_path: Path) -> None:
    file, speed = tmp_path / "calibration.json", Speed()
    calibration = load(file, speed)
    calibration.add_outcome("masks", "cpu", formula=10.0, actual=20.0)
    calibration.outcomes["masks"]["cpu"] = replace(calibration.outcomes["masks"]["cpu"], mean=300.0)
    calibration.save()
    assert load(file, speed).correction("masks", "cpu").n == 0
    assert speed.made == 2


def test_disk_error_costs_only_accuracy(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").write_text("")
    with caplog.at_level(logging.WARNING):
        calibration = load(tmp_path / "file" / "calibration.json", Speed())
    assert calibration.benchmark is not None and "cannot be kept" in caplog.text


def test_forecast_approaches_the_outcomes_and_its_range_narrows(tmp_path: Path) -> None:
    calibration = load(tmp_path / "calibration.json", Speed())
    before = calibration.correction("training", "cpu")
    for _ in range(6):
        calibration.add_outcome("training", "cpu", formula=100.0, actual=150.0)
    after = calibration.correction("training", "cpu")
    assert math.exp(after.mean) == pytest.approx(1.5, rel=0.05)
    assert after.variance < before.variance


def test_runs_that_disagree_widen_the_range(tmp_path: Path) -> None:
    steady, varying = Correction(0.0, 0.04), Correction(0.0, 0.04)
    for i in range(8):
        steady, varying = steady.updated(0.1), varying.updated(0.7 if i % 2 else -0.7)
    assert varying.variance > 10 * steady.variance


def test_outcomes_without_information_are_ignored(tmp_path: Path) -> None:
    calibration = load(tmp_path / "calibration.json", Speed())
    calibration.add_outcome("photos", "cpu", formula=0.5, actual=1.5)  # Too short.
    calibration.add_outcome("masks", "cpu", formula=100.0, actual=2.0)  # Most masks were reused.
    calibration.add_outcome("training", "memory", formula=1e9, actual=None)  # Not known on this system.
    assert calibration.outcomes == {}


def finished_project(folder: Path, *, continued: bool, beside: dict[str, float] | None = None) -> ProjectFolder:
    project = ProjectFolder.create(folder)
    figures = {} if beside is None else {"beside": beside}
    project.finish_stage(
        "masks", "key", wall_seconds=300.0, cpu_seconds=400.0, figures=figures, peak_memory=2_000_000_000,
        continued=continued,
    )  # fmt: skip
    return project


def test_next_forecast_uses_the_outcome_of_this_run(tmp_path: Path) -> None:
    calibration = load(tmp_path / "calibration.json", Speed())
    plan = work(32)
    training = training_settings(plan)

    def masks(known: Calibration) -> tuple[float, int]:
        stage = {s.stage: s for s in forecast_work(plan, training, MACHINE, known).stages}["masks"]
        return stage.seconds, stage.memory

    before = masks(calibration)
    forecast = forecast_work(plan, training, MACHINE, calibration)
    update_calibration(finished_project(tmp_path / "p", continued=False), ["masks"], plan, forecast, calibration)
    after = masks(load(tmp_path / "calibration.json", Speed()))
    assert abs(after[0] - 300.0) < 0.5 * abs(before[0] - 300.0)
    assert abs(after[1] - 2e9) < 0.5 * abs(before[1] - 2e9)


def test_stage_that_an_earlier_run_had_begun_is_ignored(tmp_path: Path) -> None:
    calibration = load(tmp_path / "calibration.json", Speed())
    plan = work(32)
    training = training_settings(plan)
    forecast = forecast_work(plan, training, MACHINE, calibration)
    update_calibration(finished_project(tmp_path / "p", continued=True), ["masks"], plan, forecast, calibration)
    assert calibration.outcomes == {} and calibration.n_runs == 0


@pytest.mark.parametrize("n_kept", [0, 1])
def test_masks_made_beside_the_cameras_tell_their_cpu_time_and_memory_alone(n_kept: int, tmp_path: Path) -> None:
    calibration = load(tmp_path / "calibration.json", Speed())
    plan = work(32)
    forecast = forecast_work(plan, training_settings(plan), MACHINE, calibration)
    beside = {"seconds": 90.0, "n_kept": n_kept, "peak_memory": 3e9}
    project = finished_project(tmp_path / "p", continued=False, beside=beside)
    update_calibration(project, ["masks"], plan, forecast, calibration)
    if n_kept:
        assert calibration.outcomes == {}
        return
    assert calibration.correction("masks", "wall").mean == 0
    assert calibration.correction("masks", "cpu").mean != 0
    masks = next(stage for stage in forecast.stages if stage.stage == "masks")
    assert 0 < calibration.correction("masks", "memory").mean <= math.log(3e9 / masks.model_memory)


def test_benchmark_measures_plausible_values(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, fewer in (("_N_GAUSSIANS", 500), ("_FEATURE_PICTURE", (320, 240))):
        monkeypatch.setattr(f"engine.pipeline.planning.benchmark.{name}", fewer)
    measured = measure_speed()
    assert 0 < measured.training_step < 5
    assert 0 < measured.features < 100
    assert measured.sam_encode is None or 0 < measured.sam_encode < 100
    assert measured.libraries is None or 100e6 < measured.libraries < 10e9


def test_first_measurement_says_that_it_takes_longer_because_kernels_are_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernels = tmp_path / "rasterizer-one"
    monkeypatch.setattr("engine.rasterizer.cache_folder", lambda: kernels)
    monkeypatch.setattr("engine.pipeline.planning.benchmark.measure_speed", Speed())
    said: list[float | None] = []

    def note(event: Event) -> None:
        if isinstance(event, Progress) and event.fraction == 0.0:
            said.append(event.seconds_left)

    for name in ("first", "again"):
        monkeypatch.setenv("GAUSSIAN_HERITAGE_CALIBRATION", str(tmp_path / f"{name}.json"))
        calibrate(MACHINE, emit=note)
        kernel = kernels / "forward_0123" / "forward.py311.1.nbc"
        kernel.parent.mkdir(parents=True, exist_ok=True)
        kernel.touch()
    first, again = said
    assert first is not None and again is not None and first > 2 * again > 0
