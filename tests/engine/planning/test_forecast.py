"""The forecast: what takes more is said to take more, and what cannot fit is refused with a way out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from engine.errors import EnvironmentProblem
from engine.machine import Machine
from engine.planning.calibration import REFERENCE, Calibration
from engine.planning.decisions import PlanSettings, WorkPlan, training_settings
from engine.planning.forecast import (
    Forecast,
    cpu_seconds_of,
    forecast_work,
    require_fit,
    step_seconds,
    training_cpu_seconds,
)

from .scenes import work

MACHINE = Machine(2, 16_000_000_000, "cpu", "test")


@pytest.fixture
def known(tmp_path: Path) -> Calibration:
    return Calibration(tmp_path / "calibration.json", "key", REFERENCE)


def forecast(plan: WorkPlan, known: Calibration, *, free: int | None = 16_000_000_000, prompts: int = 0) -> Forecast:
    machine = replace(MACHINE, free_bytes=free)
    return forecast_work(plan, training_settings(plan), machine, known, n_prompts=prompts)


def test_runs_that_were_measured_are_forecast_within_a_third() -> None:
    """CPU seconds of two whole runs of `standard` on two shared cores."""
    room, statue = work(48), work(32, width=728, height=1092)
    measured = [
        (room, "cameras", 143.0), (room, "masks", 219.0), (room, "training", 404.0),
        (statue, "cameras", 66.0), (statue, "masks", 173.0),
    ]  # fmt: skip
    for plan, stage, seconds in measured:
        said = cpu_seconds_of(stage, plan, replace(training_settings(plan), stop_when_flat=0.0), n_prompts=0)
        assert said == pytest.approx(seconds, rel=0.34), (stage, said)


def test_measured_steps_are_forecast_within_a_sixth() -> None:
    """CPU seconds of steps with trained Gaussians, degree 1, no features; the fit's own data."""
    for n, pixels, seconds in (
        (40_000, 640 * 477, 0.174), (20_000, 640 * 477, 0.113), (10_000, 640 * 477, 0.067), (40_000, 320 * 239, 0.066),
        (10_000, 320 * 239, 0.026), (40_000, 160 * 119, 0.050), (10_000, 160 * 119, 0.015),
    ):  # fmt: skip
        assert step_seconds(n, pixels, sh_degree=1, features=False) == pytest.approx(seconds, rel=0.17)


def test_more_work_is_forecast_to_take_longer(known: Calibration) -> None:
    seconds = [forecast(work(32, PlanSettings(preset=name)), known).seconds[1] for name in ("preview", "standard")]
    assert seconds[0] < seconds[1] < forecast(work(64), known).seconds[1]
    without = forecast(work(32, PlanSettings(wants_objects=False)), known)
    assert without.seconds[1] < seconds[1]
    assert [stage.stage for stage in without.stages] == ["photos", "cameras", "training", "report"]
    assert forecast(work(32), known, prompts=2).seconds[1] > seconds[1]


def test_given_cameras_take_next_to_nothing(known: Calibration) -> None:
    given, found = (forecast(work(32, poses_given=poses), known).stages[1] for poses in (True, False))
    assert given.seconds < 0.1 * found.seconds


def test_ranges_hold_the_middle_and_the_sum_is_surer_than_its_parts(known: Calibration) -> None:
    said = forecast(work(32), known)
    for stage in said.stages:
        assert stage.low < stage.seconds < stage.high and stage.memory_low < stage.memory < stage.memory_high
    low, middle, high = said.seconds
    assert sum(stage.low for stage in said.stages) < low < middle < high < sum(stage.high for stage in said.stages)


def test_more_cores_shorten_the_wall_and_not_the_work(known: Calibration) -> None:
    plan = work(32)
    two, eight = (
        forecast_work(plan, training_settings(plan), replace(MACHINE, cores=cores), known) for cores in (2, 8)
    )
    assert eight.seconds[1] < two.seconds[1]
    assert eight.stages[1].cpu_seconds == two.stages[1].cpu_seconds


def test_machine_half_as_fast_takes_twice_as_long(known: Calibration) -> None:
    slow = replace(known, benchmark=replace(REFERENCE, training_step=2 * REFERENCE.training_step))
    plan = work(32)
    assert forecast(plan, slow).stages[3].seconds == pytest.approx(2 * forecast(plan, known).stages[3].seconds)


def test_larger_libraries_are_added_to_every_stage_that_loads_them(known: Calibration) -> None:
    assert REFERENCE.libraries is not None
    heavy = replace(known, benchmark=replace(REFERENCE, libraries=REFERENCE.libraries + 800_000_000))
    usual, larger = forecast(work(32), known), forecast(work(32), heavy)
    more = {a.stage: b.memory - a.memory for a, b in zip(usual.stages, larger.stages, strict=True)}
    assert more == {"photos": 0, **dict.fromkeys(("cameras", "masks", "training", "report"), 800_000_000)}


def test_training_that_stopped_early_is_compared_with_the_steps_it_did() -> None:
    plan = work(32)
    training = training_settings(plan)
    whole = training_cpu_seconds(plan, training)
    part = training_cpu_seconds(plan, training, steps=round(0.9 * training.steps))
    assert 0.75 * whole < part < 0.95 * whole


def test_what_cannot_fit_is_refused_with_need_free_and_what_would(known: Calibration) -> None:
    plan = work(48, PlanSettings(preset="paper", wants_objects=False))
    with pytest.raises(EnvironmentProblem) as refused:
        require_fit(forecast(plan, known, free=1_500_000_000), plan, known)
    sentence = str(refused.value)
    assert refused.value.exit_code == 1
    assert "needs about" in sentence and "1.5 GB are free" in sentence and "1,000,000 Gaussians" in sentence
    assert "--preset standard" in sentence and "\n" not in sentence
    smaller = work(48, PlanSettings(preset="standard", wants_objects=False))
    require_fit(forecast(smaller, known, free=1_500_000_000), smaller, known)


def test_when_no_preset_fits_that_is_said(known: Calibration) -> None:
    plan = work(48)
    with pytest.raises(EnvironmentProblem, match="No preset fits"):
        require_fit(forecast(plan, known, free=100_000_000), plan, known)


def test_system_that_does_not_tell_its_memory_is_not_refused(known: Calibration) -> None:
    plan = work(48, PlanSettings(preset="paper"))
    require_fit(forecast(plan, known, free=None), plan, known)
