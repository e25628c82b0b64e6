"""The plan contains only the work that the scene needs and lists the rest with the reasons."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import SettingsError
from engine.pipeline.planning.decisions import (
    MIN_STEPS,
    PlanSettings,
    WorkPlan,
    evenly_spaced,
    plan_scene,
    training_settings,
)
from engine.training.settings import PRESETS

from .scenes import cameras, work

FIXTURES = Path(__file__).resolve().parents[3] / "fixtures"


def left_out_names(plan: WorkPlan) -> str:
    return "; ".join(item.what for item in plan.left_out)


def test_masks_are_evenly_spaced_and_never_more_than_requested() -> None:
    plan = plan_scene(work(48), cameras(48))
    assert 24 <= len(plan.mask_photos) <= 28
    gaps = np.diff([int(name[:3]) for name in plan.mask_photos])
    assert gaps.max() <= 4


def test_some_test_photos_get_masks_to_evaluate_the_features() -> None:
    plan = plan_scene(work(48), cameras(48))
    assert set(plan.held_out) & set(plan.mask_photos)
    assert not set(plan.held_out) >= set(plan.mask_photos)


def test_small_sets_get_masks_for_every_photo() -> None:
    assert len(plan_scene(work(16), cameras(16)).mask_photos) == 16


def test_numbers_in_the_plan_equal_those_after_the_cameras_are_known() -> None:
    for n in (3, 16, 33, 48):
        before, after = work(n), plan_scene(work(n), cameras(n))
        assert before.n_held_out == len(after.held_out)
        assert before.n_mask_photos == len(after.mask_photos)


def test_without_objects_masks_and_features_are_left_out_and_listed() -> None:
    plan = work(16, PlanSettings(wants_objects=False))
    assert plan_scene(plan, cameras(16)).mask_photos == ()
    assert not plan.features and not training_settings(plan).features.train_features
    assert any("no objects were requested" in left_out.why for left_out in plan.left_out)


def test_given_poses_leave_out_structure_from_motion() -> None:
    plan = work(16, poses_given=True)
    assert plan.pairs == "none" and "structure from motion" in left_out_names(plan)


def test_small_sets_match_every_pair_and_large_sets_the_promising_pairs() -> None:
    assert (work(16).pairs, work(16).n_pairs) == ("all", 120)
    large = work(66)
    assert large.pairs == "promising" and large.n_pairs < 66 * 65 / 2
    assert "pairs of photos" in left_out_names(large)


def test_three_photos_have_no_test_photos_and_never_stop_early() -> None:
    plan = work(3)
    assert plan.n_held_out == 0 and "test photos" in left_out_names(plan)
    assert any("few" in note for note in plan.notes)


def test_too_few_registered_photos_leave_no_test_photos_and_the_plan_says_so() -> None:
    scene = plan_scene(work(16), cameras(4))
    assert scene.held_out == ()
    assert any("could be placed" in item.why for item in scene.left_out)


@pytest.mark.parametrize("preset", ["preview", "standard", "best"])
@pytest.mark.parametrize("n", [3, 26, 120])
def test_brightness_is_corrected_with_any_number_of_photos(n: int, preset: str) -> None:
    plan = work(n, PlanSettings(preset=preset))
    assert plan.exposure and training_settings(plan).appearance.exposure
    assert not work(n, PlanSettings(preset="paper")).exposure, "the published method has none"


def test_photos_too_few_for_validation_photos_leave_out_trials_and_the_plan_says_so() -> None:
    few, enough = work(26), work(27)
    assert "trials during training" in left_out_names(few)
    assert any(item.why.startswith("23 training photos are too few") for item in few.left_out)
    assert "trials" not in left_out_names(enough)
    # Where nothing is tried anyway, this is no reason.
    assert "trials" not in left_out_names(work(26, PlanSettings(leave_out=False)))
    assert "trials" not in left_out_names(work(26, PlanSettings(preset="paper")))


def test_pictures_are_never_enlarged() -> None:
    assert (work(16, width=300, height=200).width, work(16, width=300, height=200).height) == (300, 200)
    assert (work(16, width=4000, height=3000).width, work(16, width=4000, height=3000).height) == (640, 480)


def test_nothing_is_left_out_when_leaving_out_is_off() -> None:
    plan = work(48, PlanSettings(wants_objects=False, leave_out=False))
    training = training_settings(plan)
    assert plan.n_mask_photos == 48
    assert training.features.train_features and training.appearance.exposure and training.appearance.trial_fraction == 0
    # Five times as many evaluations of the loss, each with a fifth of the weight.
    standard = PRESETS["standard"]
    assert training.features.clustering_interval == 1
    assert training.features.lambda_clustering * standard.features.clustering_interval == pytest.approx(
        standard.features.lambda_clustering
    )
    assert training.schedule.steps == PRESETS["standard"].schedule.steps


def test_unknown_preset_is_refused_with_the_list_of_presets() -> None:
    with pytest.raises(SettingsError, match="standard"):
        PlanSettings(preset="ultra")


def test_evenly_spaced_names_keep_their_order_and_cover_the_range() -> None:
    names = [str(i) for i in range(10)]
    assert evenly_spaced(names, 3) == ("1", "5", "8")
    assert evenly_spaced(names, 20) == tuple(names)


def test_few_photos_get_fewer_steps_of_the_longest_preset_and_the_plan_says_why() -> None:
    best = PRESETS["best"]
    few, many = work(64, PlanSettings(preset="best")), work(200, PlanSettings(preset="best"))
    assert many.steps == best.schedule.steps and not [left for left in many.left_out if "training steps" in left.what]
    assert few.steps == best.schedule.rounds * 56 < best.schedule.steps
    (reason,) = [left for left in few.left_out if "training steps" in left.what]
    assert reason.what == "7,968 of 12,000 training steps" and "56 photos" in reason.why and "72 times" in reason.why
    assert training_settings(few).schedule.steps == few.steps
    assert training_settings(few).appearance.sh_interval == best.appearance.sh_interval * few.steps // 12_000
    # Fewer steps must not end with fewer Gaussians.
    assert training_settings(few).growth.grow_interval == best.growth.grow_interval * few.steps // 12_000
    # The lower limit holds for any number of photos, and is what the preset standard has.
    assert work(3, PlanSettings(preset="best")).steps == work(3).steps == work(80).steps == MIN_STEPS
