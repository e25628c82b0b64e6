"""The plan: only what the scene needs, and the rest is listed with its reason."""

from __future__ import annotations

import numpy as np
import pytest

from engine.cameras.settings import CameraSettings
from engine.errors import SettingsError
from engine.planning.decisions import (
    FEWEST_STEPS,
    PlanSettings,
    WorkPlan,
    plan_scene,
    plan_work,
    spread,
    training_settings,
)
from engine.training.settings import PRESETS

from .scenes import cameras, looks, photos, work


def whats(plan: WorkPlan) -> str:
    return "; ".join(item.what for item in plan.left_out)


def with_looks(n: int, **given: list[float]) -> WorkPlan:
    return plan_work(photos(n), looks(n, **given), PlanSettings(), cameras=CameraSettings(), poses_given=False)


def test_masks_are_spread_and_never_more_than_wanted() -> None:
    plan = plan_scene(work(48), cameras(48))
    assert 24 <= len(plan.mask_photos) <= 28
    gaps = np.diff([int(name[:3]) for name in plan.mask_photos])
    assert gaps.max() <= 4


def test_some_held_out_photos_get_masks_to_judge_the_features() -> None:
    plan = plan_scene(work(48), cameras(48))
    assert set(plan.held_out) & set(plan.mask_photos)
    assert not set(plan.held_out) >= set(plan.mask_photos)


def test_small_sets_get_masks_for_every_photo() -> None:
    assert len(plan_scene(work(16), cameras(16)).mask_photos) == 16


def test_numbers_said_before_are_those_named_after_the_cameras() -> None:
    for n in (3, 16, 33, 48):
        before, after = work(n), plan_scene(work(n), cameras(n))
        assert before.n_held_out == len(after.held_out)
        assert before.n_mask_photos == len(after.mask_photos)


def test_without_objects_masks_and_features_are_left_out_and_said() -> None:
    plan = work(16, PlanSettings(wants_objects=False))
    assert plan_scene(plan, cameras(16)).mask_photos == ()
    assert not plan.features and not training_settings(plan).features
    assert any("no objects were asked for" in left_out.why for left_out in plan.left_out)


def test_given_poses_leave_out_structure_from_motion() -> None:
    plan = work(16, poses_given=True)
    assert plan.pairs == "none" and "structure from motion" in whats(plan)


def test_small_sets_match_every_pair_and_large_ones_the_promising() -> None:
    assert (work(16).pairs, work(16).n_pairs) == ("all", 120)
    large = work(66)
    assert large.pairs == "promising" and large.n_pairs < 66 * 65 / 2
    assert "pairs of photos" in whats(large)


def test_three_photos_spare_none_and_are_never_stopped_early() -> None:
    plan = work(3)
    assert plan.n_held_out == 0 and "held-out photos" in whats(plan)
    assert training_settings(plan).stop_when_flat == 0
    assert any("few" in note for note in plan.notes)


def test_photos_lost_while_placing_them_leave_none_to_hold_out_and_that_is_said() -> None:
    scene = plan_scene(work(16), cameras(4))
    assert scene.held_out == ()
    assert any("could be placed" in item.why for item in scene.left_out)


def test_brightness_is_corrected_when_exif_says_that_exposures_differ() -> None:
    automatic = with_looks(4, values=[8.0, 8.2, 8.9, 8.1])
    assert automatic.exposure and training_settings(automatic).exposure
    manual = with_looks(4, values=[8.0] * 4, brightness=[-1.0, -3.0, -5.0, -2.0])
    assert not manual.exposure, "what the photos show differs, their exposure does not"
    assert any("0.00 stops" in item.why and "0.5" in item.why for item in manual.left_out)


def test_brightness_correction_is_tried_where_exif_does_not_say_and_a_trial_costs_little() -> None:
    assert work(48).exposure and training_settings(work(48)).trial > 0
    assert not work(48, PlanSettings(preset="preview")).exposure, "two rounds through the photos are a quarter of it"


def test_brightness_is_corrected_without_exif_and_trial_only_when_photos_differ_much() -> None:
    assert not with_looks(4, brightness=[-2.0, -2.5, -3.0, -2.2]).exposure
    assert with_looks(4, brightness=[-2.0, -4.0, -1.0, -5.0]).exposure


def test_pictures_are_never_enlarged() -> None:
    assert (work(16, width=300, height=200).width, work(16, width=300, height=200).height) == (300, 200)
    assert (work(16, width=4000, height=3000).width, work(16, width=4000, height=3000).height) == (640, 480)


def test_everything_on_leaves_nothing_out_that_can_be_done() -> None:
    plan = work(48, PlanSettings(wants_objects=False, leave_out=False))
    training = training_settings(plan)
    assert plan.n_mask_photos == 48
    assert training.features and training.exposure and training.stop_when_flat == 0 and training.trial == 0
    # In every step, each counting for less: the same loss on the whole.
    standard = PRESETS["standard"]
    assert training.clustering_interval == 1
    assert training.lambda_clustering * standard.clustering_interval == pytest.approx(standard.lambda_clustering)
    assert training.steps == PRESETS["standard"].steps


def test_unknown_preset_is_refused_with_those_there_are() -> None:
    with pytest.raises(SettingsError, match="standard"):
        PlanSettings(preset="ultra")


def test_spread_keeps_order_and_ends() -> None:
    names = [str(i) for i in range(10)]
    assert spread(names, 3) == ("1", "5", "8")
    assert spread(names, 20) == tuple(names)


def test_few_photos_get_fewer_steps_and_the_plan_says_why() -> None:
    standard = PRESETS["standard"]
    few, many = work(32), work(80)
    assert many.steps == standard.steps and not [left for left in many.left_out if "training steps" in left.what]
    assert few.steps == standard.rounds * 28 < standard.steps
    (told,) = [left for left in few.left_out if "training steps" in left.what]
    assert told.what == "984 of 3,000 training steps" and "28 photos" in told.why and "72 times" in told.why
    assert training_settings(few).steps == few.steps
    assert training_settings(few).sh_interval == standard.sh_interval * few.steps // standard.steps
    # However few there are, so many are done.
    assert work(3).steps == FEWEST_STEPS


def test_people_are_left_out_only_when_asked_for() -> None:
    assert not training_settings(work(32)).passers_by
    assert training_settings(work(32, settings=PlanSettings(passers_by=True))).passers_by
