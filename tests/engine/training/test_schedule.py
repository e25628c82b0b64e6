"""Schedule of a run: every photo once per round, small pictures first, and settings out of bounds are refused."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from engine.core.errors import SettingsError
from engine.training import settings_with_sizes, sizes_on_card, validation_photos
from engine.training.schedule import COOLDOWN_END, Schedule
from engine.training.settings import MAX_GROW_FACTOR, PRESETS, TrainingSettings
from engine.training.spectrum import coarse_shares

from .conftest import Scene

STANDARD = PRESETS["standard"]
BEST_ON_A_CARD = settings_with_sizes("best", sizes_on_card("best", 10**9, n_training=42), 42)


def test_every_photo_is_used_once_a_round_in_a_new_order() -> None:
    schedule = Schedule(STANDARD, 7, 1.0)
    rounds = [[schedule.view(7 * r + i) for i in range(7)] for r in range(3)]
    assert all(sorted(order) == list(range(7)) for order in rounds)
    assert rounds[0] != rounds[1] or rounds[1] != rounds[2]


def test_segments_are_learned_from_the_photos_that_have_them() -> None:
    settings = STANDARD.changed(clustering_interval=3)
    schedule = Schedule(settings, 7, 1.0, labelled=[2, 5])
    views = [schedule.view(step) for step in range(3 * 8)]
    assert sorted(views[::3]) == [2, 2, 2, 2, 5, 5, 5, 5]
    others = [view for step, view in enumerate(views) if step % 3]
    assert sorted(others[:7]) == sorted(others[7:14]) == list(range(7))


def test_opacity_is_held_down_until_gaussians_are_first_added() -> None:
    settings = STANDARD.changed(steps=200, grow_from=0.05, lambda_opacity=0.3, lambda_opacity_end=0.1)
    weights = [Schedule(settings, 30, 1.0).lambda_opacity(step) for step in range(200)]
    assert weights == [0.3] * 10 + [0.1] * 190


def test_picture_size_follows_the_detail_of_the_photos_up_to_full_size() -> None:
    settings = STANDARD.changed(steps=100, coarse_levels=2)

    def sizes(*shares: float) -> list[int]:
        schedule = Schedule(settings, 3, 1.0, shares=shares)
        return [schedule.reductions(step) for step in range(100)]

    assert sizes(1.0, 0.9, 0.8, 0.6, 0.4) == [4] * 20 + [3] * 10 + [2] * 10 + [1] * 5 + [0] * 55
    # Photos without fine detail need full size later, those of nothing but noise sooner.
    assert sizes(1.0, 1.0, 1.0, 1.0, 0.8) == [4] * 40 + [3] * 10 + [0] * 50
    assert sizes(1.0, 0.5, 0.25, 0.125, 0.0625).count(0) == 75
    assert Schedule(settings, 3, 1.0).scale(0) == 0.25
    assert Schedule(settings, 3, 1.0).scale(99) == 1.0


def test_detail_of_blurred_photos_is_coarse_and_that_of_noise_is_fine(scene: Scene) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8)
    blurred = cv2.GaussianBlur(noise, (0, 0), 3.0)

    def shares(pixels: np.ndarray, valid: np.ndarray | None = None) -> tuple[float, ...]:
        return coarse_shares([replace(scene.views[0], pixels=pixels, valid=valid)], 4)

    for found in (shares(noise), shares(blurred)):
        assert found[0] == 1.0 and list(found) == sorted(found, reverse=True)
    # Of noise, as many amplitudes as pixels: a quarter below half the Nyquist frequency.
    assert shares(noise)[2] == pytest.approx(0.25, abs=0.05)
    assert shares(blurred)[2] > 0.8
    assert shares(np.full_like(noise, 77)) == (1.0,) * 5
    # What does not count has no part in it.
    valid = np.ones((48, 64), bool)
    valid[:, 30:] = False
    painted = noise.copy()
    painted[~valid] = 0
    assert shares(noise, valid) == shares(painted, valid)


@pytest.mark.parametrize("start", [1, 500, 7000, 39_990, 40_000, 50_000])
@pytest.mark.parametrize("settings", [STANDARD, BEST_ON_A_CARD])
def test_the_budget_is_reached_at_the_same_part_of_the_run_from_any_number_of_points(
    settings: TrainingSettings, start: int
) -> None:
    schedule, growth, steps = Schedule(settings, 3, 1.0), settings.growth, settings.schedule.steps
    n, numbers, factors = start, [], []
    for step in range(steps):
        if schedule.grows(step):
            before, n = n, schedule.gaussians_after_growth(step, n)
            # Small pictures show less detail.
            assert before <= n <= max(start, growth.max_gaussians * schedule.scale(step))
            factors.append(n / before)
        numbers.append(n)
    full_at = round(steps * (growth.grow_from + growth.full_by * (growth.grow_until - growth.grow_from)))
    assert n == numbers[full_at] == max(start, growth.max_gaussians)
    if start < growth.max_gaussians:
        assert numbers[full_at - 2 * growth.grow_interval] < n
    assert max(factors) <= MAX_GROW_FACTOR


def test_growth_by_equal_factors_has_no_steps() -> None:
    schedule = Schedule(STANDARD.changed(coarse_levels=0), 3, 1.0)
    n, factors = 7000, []
    for step in range(STANDARD.schedule.steps):
        if schedule.grows(step):
            before, n = n, schedule.gaussians_after_growth(step, n)
            factors.append(n / before)
    grown = [factor for factor in factors if factor > 1]
    # Numbers are whole: 7,000 become 40,000 by factors of 1.066, of which rounding changes the third place.
    assert len(grown) == pytest.approx(0.7 * len(factors), abs=2) and max(grown) - min(grown) < 0.005


def test_progress_runs_from_nothing_to_all() -> None:
    schedule = Schedule(STANDARD, 3, 1.0)
    done = [schedule.done(step) for step in range(STANDARD.schedule.steps + 1)]
    assert done[0] == 0
    assert done[-1] == 1
    assert done == sorted(done)


def test_curve_ends_at_the_last_step() -> None:
    for steps in (1, 5, 60, 3000):
        points = Schedule(STANDARD.changed(steps=steps), 3, 1.0).curve_steps
        assert max(points) == steps
        assert min(points) >= 1
    assert Schedule(STANDARD.changed(curve_points=1), 3, 1.0).curve_steps == {STANDARD.schedule.steps}


def test_random_draws_depend_on_step_and_purpose_alone() -> None:
    first, again = (Schedule(STANDARD, 3, 1.0).generator(5, 1).initial_seed() for _ in range(2))
    assert first == again
    others = {
        Schedule(STANDARD, 3, 1.0).generator(step, purpose).initial_seed() for step in (5, 6) for purpose in (1, 2)
    }
    assert len(others) == 4


def test_rates_fall_to_the_end_and_further_in_the_cooldown() -> None:
    schedule = Schedule(STANDARD, 3, extent=2.0)
    assert schedule.learning_rates(0)["means"] == pytest.approx(2 * STANDARD.optimiser.lr_means)
    last = schedule.learning_rates(STANDARD.schedule.steps)
    assert last["means"] == pytest.approx(2 * STANDARD.optimiser.lr_means_end * COOLDOWN_END, rel=0.01)
    assert last["sh_dc"] == pytest.approx(STANDARD.optimiser.lr_sh * STANDARD.optimiser.lr_end * COOLDOWN_END, rel=0.01)
    assert schedule.exposure_rate(0) == STANDARD.optimiser.lr_exposure
    assert schedule.exposure_rate(STANDARD.schedule.steps) == pytest.approx(
        STANDARD.optimiser.lr_exposure * STANDARD.optimiser.lr_end * COOLDOWN_END, rel=0.01
    )
    without = Schedule(STANDARD.changed(cooldown=0.0), 3, extent=2.0)
    assert without.learning_rates(STANDARD.schedule.steps - 1)["means"] == pytest.approx(
        2 * STANDARD.optimiser.lr_means_end
    )


def test_a_trial_cools_down_over_its_own_steps_and_adds_no_gaussians() -> None:
    schedule = Schedule(STANDARD, 28, extent=2.0)
    trial = schedule.of_trial(1500)
    end = 1500 + schedule.trial_steps
    for name, rate in trial.learning_rates(end).items():
        undisturbed = schedule.learning_rates(end)["sh_dc" if name == "sh_rest" else name]
        assert rate == pytest.approx(COOLDOWN_END * undisturbed), name
    assert not schedule.growth_ended(1500) and trial.growth_ended(1500)
    assert set(trial.trained_on(2000)) == set(range(28)) - {4, 14, 23}


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("steps", 0),
        ("lr_means", 0.0),
        ("cooldown", 1.5),
        ("held_out_every", 1),
        ("growth_strategy", "x"),
        ("sh_degree", 4),
    ],
)
def test_settings_out_of_bounds_are_refused_by_name(field: str, value: object) -> None:
    with pytest.raises(SettingsError, match=field):
        STANDARD.changed(**{field: value})


def test_paper_features_have_no_ray_term() -> None:
    with pytest.raises(SettingsError, match="lambda_ray"):
        STANDARD.changed(feature_init="paper", lambda_ray=0.1)


@pytest.mark.parametrize(("n", "n_validation"), [(1, 0), (23, 0), (24, 3), (42, 5), (66, 8), (400, 8)])
def test_a_few_evenly_spaced_training_photos_are_validation_photos(n: int, n_validation: int) -> None:
    chosen = validation_photos(n)
    assert len(chosen) == len(set(chosen)) == n_validation
    gaps = np.diff([-chosen[0] - 1, *chosen, 2 * n - chosen[-1] - 1]) if chosen else np.zeros(1)
    assert gaps.max() - gaps.min() <= 2


@pytest.mark.parametrize("labelled", [(), (0, 4, 5, 14, 20)])
def test_validation_photos_are_trained_on_as_often_as_others_once_everything_is_decided(
    labelled: tuple[int, ...],
) -> None:
    schedule = Schedule(STANDARD.changed(clustering_interval=4), 28, 1.0, labelled=labelled)
    last = max(schedule.trials)
    assert schedule.validation == (4, 14, 23) and schedule.validation_until == last == 1500
    before = [schedule.view(step) for step in range(last)]
    assert set(before) == set(range(28)) - {4, 14, 23}
    after = [step for step in range(last, STANDARD.schedule.steps)]
    rounds = [schedule.view(step) for step in after if not labelled or step % 4]
    for first in range(0, len(rounds) - 28, 28):
        assert sorted(rounds[first : first + 28]) == list(range(28))
    if labelled:
        steps = [step for step in after if step % 4 == 0]
        assert sorted(schedule.view(step) for step in steps[:5]) == sorted(labelled)
        assert {schedule.view(step) for step in range(0, last, 4)} == {0, 5, 20}


def test_no_photo_is_left_out_where_nothing_is_to_be_decided() -> None:
    nothing = STANDARD.changed(sh_degree=0)
    assert Schedule(nothing, 28, 1.0).validation == () and Schedule(STANDARD, 23, 1.0).validation == ()
    assert sorted(Schedule(nothing, 28, 1.0).view(step) for step in range(28)) == list(range(28))
