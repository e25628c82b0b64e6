"""The plan of a run: every photo once a round, coarse first, and settings refused out of bounds."""

from __future__ import annotations

from dataclasses import replace

import pytest

from engine.errors import SettingsError
from engine.settings import from_dict, to_dict
from engine.training.schedule import Schedule
from engine.training.settings import PRESETS, TrainingSettings

STANDARD = PRESETS["standard"]


def test_every_photo_is_used_once_a_round_in_a_new_order() -> None:
    schedule = Schedule(STANDARD, 7, 1.0)
    rounds = [[schedule.view(7 * r + i) for i in range(7)] for r in range(3)]
    assert all(sorted(order) == list(range(7)) for order in rounds)
    assert rounds[0] != rounds[1] or rounds[1] != rounds[2]


def test_segments_are_learned_from_the_photos_that_have_them() -> None:
    settings = replace(STANDARD, clustering_interval=3)
    schedule = Schedule(settings, 7, 1.0, labelled=[2, 5])
    views = [schedule.view(step) for step in range(3 * 8)]
    assert sorted(views[::3]) == [2, 2, 2, 2, 5, 5, 5, 5]
    others = [view for step, view in enumerate(views) if step % 3]
    assert sorted(others[:7]) == sorted(others[7:14]) == list(range(7))


def test_pictures_grow_to_full_size_and_stay() -> None:
    settings = replace(STANDARD, steps=100, coarse_levels=2, coarse_until=0.4)
    halvings = [Schedule(settings, 3, 1.0).halvings(step) for step in range(100)]
    assert halvings == [2] * 20 + [1] * 20 + [0] * 60


@pytest.mark.parametrize("start", [500, 7000, 39_990, 40_000, 50_000])
def test_the_budget_is_reached_half_way_and_never_passed(start: int) -> None:
    schedule = Schedule(STANDARD, 3, 1.0)
    n = start
    for step in range(STANDARD.steps):
        if schedule.grows(step):
            n = schedule.gaussians_after_growth(step, n)
        if step == STANDARD.steps // 2:
            assert n >= 0.9 * STANDARD.max_gaussians
    assert n == max(start, STANDARD.max_gaussians)


def test_progress_runs_from_nothing_to_all() -> None:
    schedule = Schedule(STANDARD, 3, 1.0)
    done = [schedule.done(step) for step in range(STANDARD.steps + 1)]
    assert done[0] == 0
    assert done[-1] == 1
    assert done == sorted(done)


def test_curve_ends_at_the_last_step() -> None:
    for steps in (1, 5, 60, 3000):
        points = Schedule(replace(STANDARD, steps=steps), 3, 1.0).curve_steps
        assert max(points) == steps
        assert min(points) >= 1
    assert Schedule(replace(STANDARD, curve_points=1, stop_when_flat=0.0), 3, 1.0).curve_steps == {STANDARD.steps}


def test_random_draws_depend_on_step_and_purpose_alone() -> None:
    first, again = (Schedule(STANDARD, 3, 1.0).generator(5, 1).initial_seed() for _ in range(2))
    assert first == again
    others = {
        Schedule(STANDARD, 3, 1.0).generator(step, purpose).initial_seed() for step in (5, 6) for purpose in (1, 2)
    }
    assert len(others) == 4


def test_position_rate_falls_exponentially() -> None:
    schedule = Schedule(STANDARD, 3, extent=2.0)
    assert schedule.learning_rates(0)["means"] == pytest.approx(2 * STANDARD.lr_means)
    assert schedule.learning_rates(STANDARD.steps - 1)["means"] == pytest.approx(2 * STANDARD.lr_means_end)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_presets_come_back_from_json(name: str) -> None:
    assert from_dict(TrainingSettings, to_dict(PRESETS[name])) == PRESETS[name]


@pytest.mark.parametrize(
    ("field", "value"),
    [("steps", 0), ("lr_means", 0.0), ("lambda_dssim", 1.5), ("held_out_every", 1), ("growth", "x"), ("sh_degree", 4)],
)
def test_settings_out_of_bounds_are_refused_by_name(field: str, value: object) -> None:
    with pytest.raises(SettingsError, match=field):
        replace(STANDARD, **{field: value})


def test_paper_features_have_no_ray_term() -> None:
    with pytest.raises(SettingsError, match="lambda_ray"):
        replace(STANDARD, feature_init="paper", lambda_ray=0.1)


def test_whether_more_steps_are_worth_it_is_asked_only_after_growth() -> None:
    checks = Schedule(replace(STANDARD, stop_when_flat=0.05), 3, 1.0).flat_checks
    assert min(checks) == STANDARD.grow_until * STANDARD.steps and max(checks) < STANDARD.steps
    assert Schedule(replace(STANDARD, stop_when_flat=0.0), 3, 1.0).flat_checks == frozenset()
