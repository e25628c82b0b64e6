"""Defects that are put into training on purpose turn the right rows of the table red."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from engine.quality.stability import training_measure, training_scenes
from engine.quality.stability.table import run_case, select_cases
from engine.quality.stability.training_table import TrainingRow
from engine.training import checkpoint, cpu_steps, densify, guards, initialise, views
from engine.training import loop as train
from engine.training.adam import AdamState
from engine.training.schedule import Schedule

pytestmark = pytest.mark.usefixtures("training_rows")
"""The PSNR of the undisturbed runs, on which floors depend, is cached before anything is broken."""


def problems_of(case: str) -> str:
    """Return the problems of the case, an empty string if it is green."""
    row = run_case(select_cases(case)[0])
    assert isinstance(row, TrainingRow)
    return "; ".join(row.finding.problems)


def test_missing_check_of_gradients_is_found_in_the_checkpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guards, "_rows_not_finite", lambda parameters: None)
    monkeypatch.setattr(checkpoint, "_check_finite", lambda arrays, step: None)
    assert "`second.opacity_logits` of the checkpoint" in problems_of("weight_1e25")


def test_a_checkpoint_that_is_not_finite_is_refused_when_it_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guards, "_rows_not_finite", lambda parameters: None)
    assert "`second.opacity_logits` is not finite after step 30" in problems_of("weight_1e25")


def test_missing_clamping_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (train, cpu_steps):
        monkeypatch.setattr(module, "clamp_parameters", lambda *arguments: None)
    assert "`scales` is not finite" in problems_of("start_scales_1e39")


def test_rates_that_rise_instead_of_falling_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    original = Schedule.learning_rates

    def rising(self: Schedule, step: int, *more: Any) -> dict[str, float]:
        factor = 2.0 ** (6 * step / self._settings.schedule.steps)
        return {name: factor * rate for name, rate in original(self, step, *more).items()}

    monkeypatch.setattr(Schedule, "learning_rates", rising)
    assert "less than" in problems_of("undisturbed")


def test_growth_beyond_the_budget_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Schedule, "gaussians_after_growth", lambda self, step, n: n + 2)
    assert "10 are allowed" in problems_of("budget_10")


def test_a_budget_that_is_not_used_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Schedule, "gaussians_after_growth", lambda self, step, n: n + 1)
    assert "dB on the training photos, less than 40" in problems_of("budget_2_million")


def test_growth_faster_than_gaussians_settle_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Schedule, "gaussians_after_growth", lambda self, step, n: 3 * n if n < 10_000 else n)
    assert "Gaussians became" in problems_of("budget_2_million")


@pytest.mark.parametrize("case", ["stopped", "killed"])
def test_a_checkpoint_without_the_state_of_adam_is_found(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    original = checkpoint._state_from

    def without_moments(arrays: Any, record: Any) -> checkpoint.RunState:
        state = original(arrays, record)
        state.parameters.moments = {n: AdamState.zeros_like(v) for n, v in state.parameters.values.items()}
        return state

    monkeypatch.setattr(checkpoint, "_state_from", without_moments)
    assert "the Gaussians differ" in problems_of(case)


def test_random_draws_that_do_not_depend_on_the_step_alone_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    generator = torch.Generator().manual_seed(0)
    monkeypatch.setattr(Schedule, "generator", lambda self, step, purpose: generator)
    assert "the Gaussians differ" in problems_of("stopped")


def test_georeferenced_poses_that_are_not_normalised_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training_scenes, "original_from_world", lambda viewmats, points: np.eye(4))
    for case in ("world_utm", "world_1e-6"):
        assert problems_of(case), case


@pytest.mark.parametrize(
    ("module", "name", "case"),
    [
        (train, "check_start", "start_sh_nan"),
        (train, "check_result", "opacity_all_0"),
        (train, "flat_psnr", "rates_x1000"),
        (views, "_check_size", "other_size_held_out"),
    ],
)
def test_a_missing_check_is_found(module: Any, name: str, case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, name, lambda *_, **__: 0.0)
    try:
        assert problems_of(case)
    except RuntimeError as error:  # without the check, the error of torch reaches the user
        assert "size of tensor" in str(error)


def test_added_points_with_another_brightness_than_the_photos_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A defect that the first run of the suite found: in dark photos, gray points were still visible after training."""
    original = initialise._with_random_points

    def gray(*arguments: Any) -> Any:
        places, tints = original(*arguments)
        tints[-((arguments[2] - len(arguments[0])) // 2) :] = 127.5
        return places, tints

    monkeypatch.setattr(initialise, "_with_random_points", gray)
    assert "less than" in problems_of("under_exposed")


def test_noise_that_moves_gaussians_out_of_the_scene_is_found(
    monkeypatch: pytest.MonkeyPatch, training_rows: dict[str, TrainingRow]
) -> None:
    """A defect that the first run of the suite found: noise moved large Gaussians by a hundred extents in a step."""
    assert not training_rows["opacity_half_0"].finding.guards.get("clamped_positions")
    monkeypatch.setattr(densify, "MAX_WALK", 1e9)
    row = run_case(select_cases("opacity_half_0")[0])
    assert isinstance(row, TrainingRow) and row.finding.guards["clamped_positions"] > 0


def test_a_scene_that_is_not_finite_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    original = training_measure.train

    def broken(*args: Any, **options: Any) -> Any:
        result = original(*args, **options)
        result.gaussians.means[0] = np.nan
        return result

    monkeypatch.setattr(training_measure, "train", broken)
    assert "values of `means` are not finite" in problems_of("undisturbed")
