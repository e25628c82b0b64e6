"""The suite is worth its table: training that is broken on purpose turns rows red, and the right ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from engine.gaussians import initialise
from engine.rasterizer.adam import AdamState
from engine.stability import training_measure, training_scenes
from engine.stability.table import judge, select
from engine.stability.training_table import TrainingRow
from engine.training import checkpoint, densify, guards, views
from engine.training import loop as train
from engine.training.schedule import Schedule

pytestmark = pytest.mark.usefixtures("training_rows")
"""What other cases are measured by is known before anything is broken."""


def red(case: str) -> str:
    """Return why the case is red, nothing when it is green."""
    row = judge(select(case)[0])
    assert isinstance(row, TrainingRow)
    return "; ".join(row.finding.problems)


def test_gradients_that_are_not_checked_are_seen_in_the_checkpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guards, "_rows_not_finite", lambda parameters: None)
    monkeypatch.setattr(checkpoint, "_check_finite", lambda arrays, step: None)
    assert "`second.opacity_logits` of the checkpoint" in red("weight_1e25")


def test_a_checkpoint_that_is_not_finite_is_refused_by_whoever_writes_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guards, "_rows_not_finite", lambda parameters: None)
    assert "`second.opacity_logits` is not finite after step 30" in red("weight_1e25")


def test_values_that_are_not_held_in_bounds_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(train, "clamp_parameters", lambda *arguments: None)
    assert "`scales` is not finite" in red("start_scales_1e39")


def test_rates_that_rise_instead_of_falling_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = Schedule.learning_rates

    def rising(self: Schedule, step: int, *more: Any) -> dict[str, float]:
        return {name: 2.0 ** (step / 20) * rate for name, rate in whole(self, step, *more).items()}

    monkeypatch.setattr(Schedule, "learning_rates", rising)
    assert "less than" in red("undisturbed")


def test_growth_beyond_the_budget_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Schedule, "gaussians_after_growth", lambda self, step, n: n + 2)
    assert "10 are allowed" in red("budget_10")


def test_growth_faster_than_gaussians_settle_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Schedule, "gaussians_after_growth", lambda self, step, n: 2 * n if n < 5_000 else n)
    assert "Gaussians came of" in red("budget_2_million")


@pytest.mark.parametrize("case", ["stopped", "killed"])
def test_a_checkpoint_that_forgets_the_state_of_adam_is_seen(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = checkpoint._state_from

    def forgetful(arrays: Any, record: Any) -> checkpoint.RunState:
        state = whole(arrays, record)
        state.parameters.moments = {n: AdamState.zeros_like(v) for n, v in state.parameters.values.items()}
        return state

    monkeypatch.setattr(checkpoint, "_state_from", forgetful)
    assert "the Gaussians are others" in red(case)


def test_random_draws_that_do_not_depend_on_the_step_alone_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    generator = torch.Generator().manual_seed(0)
    monkeypatch.setattr(Schedule, "generator", lambda self, step, purpose: generator)
    assert "the Gaussians are others" in red("stopped")


def test_georeferenced_poses_that_are_not_normalised_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training_scenes, "original_from_world", lambda viewmats, points: np.eye(4))
    for case in ("world_utm", "world_1e-6"):
        assert red(case), case


@pytest.mark.parametrize(
    ("module", "name", "case"),
    [
        (train, "check_start", "start_sh_nan"),
        (train, "check_result", "opacity_all_0"),
        (train, "flat_psnr", "rates_x100"),
        (views, "_check_size", "other_size_held_out"),
    ],
)
def test_a_check_that_is_left_out_is_seen(module: Any, name: str, case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, name, lambda *_, **__: 0.0)
    try:
        assert red(case)
    except RuntimeError as error:  # torch's own words reach the person
        assert "size of tensor" in str(error)


def test_invented_points_of_another_brightness_than_the_photos_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the suite found in its first run: in dark photos, gray ones had not faded when training ended."""
    whole = initialise._thickened

    def gray(*arguments: Any) -> Any:
        places, tints = whole(*arguments)
        tints[-((arguments[2] - len(arguments[0])) // 2) :] = 127.5
        return places, tints

    monkeypatch.setattr(initialise, "_thickened", gray)
    assert "less than" in red("under_exposed")


def test_noise_that_throws_gaussians_out_of_the_scene_is_seen(
    monkeypatch: pytest.MonkeyPatch, training_rows: dict[str, TrainingRow]
) -> None:
    """What the suite found in its first run: at our rates, noise moved large Gaussians a hundred extents in a step."""
    assert not training_rows["opacity_half_0"].finding.guards.get("clamped_positions")
    monkeypatch.setattr(densify, "_LONGEST_WALK", 1e9)
    row = judge(select("opacity_half_0")[0])
    assert isinstance(row, TrainingRow) and row.finding.guards["clamped_positions"] > 0


def test_a_scene_file_that_is_not_finite_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = training_measure.load_gaussians

    def broken(folder: Any) -> Any:
        scene = whole(folder)
        scene.means[0] = np.nan
        return scene

    monkeypatch.setattr(training_measure, "load_gaussians", broken)
    assert "`means` of the scene is not finite" in red("undisturbed")
