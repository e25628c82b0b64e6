"""Test photos decide nothing. Validation photos decide, and are trained on once everything is decided."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from engine.errors import Cancelled
from engine.events import Event, Progress, StopCheck, ignore_events, never_stop
from engine.scene.gaussians import Gaussians
from engine.training.checkpoint import RunState, read_state
from engine.training.held_out import CurvePoint, expected_gain
from engine.training.loop import train
from engine.training.result import TrainingResult
from engine.training.settings import PRESETS, TrainingSettings
from engine.training.views import TrainingView

from .conftest import Scene

FLAT = PRESETS["test"].changed(steps=120, grow_until=0.4, checkpoint_interval=7, stop_when_flat=1e3)
EVERYTHING = FLAT.changed(
    sh_degree=1, sh_interval=20, exposure=True, transients=True, trial_fraction=0.1, lr_exposure=0.01
)  # fmt: skip
"""Trials of a band at step 20 and of brightness factors at step 30, of 50 steps each, and an early stop at step 81."""
VALIDATION = ("05.jpg", "16.jpg", "26.jpg")


def run(
    scene: Scene,
    settings: TrainingSettings,
    folder: Path,
    *,
    views: list[TrainingView] | None = None,
    events: list[Event] | None = None,
    stop: StopCheck = never_stop,
) -> TrainingResult:
    emit = ignore_events if events is None else events.append
    return train(scene.start, views or scene.views, settings, checkpoints=folder, emit=emit, should_stop=stop)


def stop_after(calls: int) -> StopCheck:
    times = iter(range(10**9))
    return lambda: next(times) >= calls


def same(one: Gaussians, other: Gaussians) -> bool:
    pairs = [(getattr(one, f.name), getattr(other, f.name)) for f in fields(one)]
    return all((a is None and b is None) or np.array_equal(a, b) for a, b in pairs)


def with_noise(scene: Scene, photos: Callable[[TrainingView], bool]) -> list[TrainingView]:
    """The photos, with random pixels and segments in some of them."""
    rng = np.random.default_rng(5)
    return [
        replace(
            view,
            pixels=rng.integers(0, 255, view.pixels.shape, dtype=np.uint8),
            labels=rng.integers(0, 4, view.pixels.shape[:2], dtype=np.int32),
        )
        if photos(view)
        else view
        for view in scene.views
    ]


def darkened(scene: Scene) -> Scene:
    """The scene in photos of which every other one is much darker."""
    views = [
        replace(view, pixels=(view.pixels * (0.6 if i % 2 else 1.0)).round().astype(np.uint8))
        for i, view in enumerate(scene.views)
    ]
    return replace(scene, views=views)


def test_no_pixel_of_a_test_photo_influences_the_result(large_scene: Scene, tmp_path: Path) -> None:
    result = run(large_scene, EVERYTHING, tmp_path / "photos")
    changed = with_noise(large_scene, lambda view: view.held_out)
    noise = run(large_scene, EVERYTHING, tmp_path / "noise", views=changed)
    assert same(noise.gaussians, result.gaussians)
    for name in ("trials", "stopped_early", "steps", "exposure", "out_of_place", "measured_photos"):
        ours, theirs = result.figures.get(name), noise.figures.get(name)
        if name == "stopped_early":
            ours, theirs = ours["expected_gain"], theirs["expected_gain"]
        assert ours == theirs, name
    assert len(result.figures["trials"]) == 2 and result.figures["stopped_early"]
    assert result.figures["measured_on"] == "test photos"
    assert not {*result.figures["measured_photos"]} & {*result.figures["validation_photos"]}
    # The noise is measured, and nothing like it is in the scene.
    assert noise.figures["psnr"] < result.figures["psnr"] - 5


def test_decisions_depend_on_the_validation_photos(large_scene: Scene, tmp_path: Path) -> None:
    settings = PRESETS["test"].changed(
        steps=300, trial_fraction=0.2, min_trial_gain=0.1, exposure=True, lr_exposure=0.01, train_features=False
    )
    # Brightness factors correct the darker photos, which noise does not show.
    dark = darkened(large_scene)
    kept = run(dark, settings, tmp_path / "photos")
    assert [trial["kept"] for trial in kept.figures["trials"]] == [True]
    assert tuple(kept.figures["validation_photos"]) == VALIDATION
    noise = with_noise(dark, lambda view: view.photo in VALIDATION)
    refused = run(dark, settings, tmp_path / "noise", views=noise)
    assert [trial["kept"] for trial in refused.figures["trials"]] == [False]
    # Their own brightness is learned when they are trained on.
    factors = {name: float(np.mean(kept.figures["exposure"][name])) for name in VALIDATION}
    assert factors["05.jpg"] / factors["16.jpg"] == pytest.approx(0.6, abs=0.06)


def test_validation_photos_are_trained_on_after_the_last_decision_and_not_before(
    large_scene: Scene, tmp_path: Path
) -> None:
    # One trial at step 40, which nothing can pass.
    settings = PRESETS["test"].changed(
        steps=100, sh_degree=1, sh_interval=40, trial_fraction=0.1, min_trial_gain=99.0, coarse_levels=0
    )
    views = with_noise(large_scene, lambda view: view.photo in VALIDATION)

    def state_at(step: int, folder: Path, views: list[TrainingView]) -> RunState:
        calls = step if step <= 40 else step + 2 * 50
        with pytest.raises(Cancelled):
            run(large_scene, settings, folder, views=views, stop=stop_after(calls))
        state = read_state(folder)
        assert state is not None and state.step == step and len(state.trials) == (step > 40)
        return state

    means = {
        (step, kind): state_at(step, tmp_path / f"{kind} {step}", chosen).parameters.values["means"].numpy()
        for step in (40, 80)
        for kind, chosen in (("photos", large_scene.views), ("noise", views))
    }
    assert np.array_equal(means[40, "photos"], means[40, "noise"])
    assert not np.array_equal(means[80, "photos"], means[80, "noise"])


def test_with_few_photos_settings_decide_and_every_photo_is_trained_on(scene: Scene, tmp_path: Path) -> None:
    result = run(scene, EVERYTHING, tmp_path)
    figures = result.figures
    assert (figures["trials"], figures["validation_photos"], figures["stopped_early"]) == ([], [], None)
    assert figures["steps"] == 120 and figures["sh_degree"] == 1
    assert sorted(figures["exposure"]) == [view.photo for view in scene.views if not view.held_out]


def test_training_stops_when_the_remaining_steps_would_gain_too_little(large_scene: Scene, tmp_path: Path) -> None:
    events: list[Event] = []
    result = run(large_scene, FLAT, tmp_path, events=events)
    # Full size from step 60 on; the first seven checks cannot tell a slope; the cooldown takes 12 steps.
    assert result.figures["steps"] == result.curve[-1].step == 60 + 7 * 3 + 12
    stopped = result.figures["stopped_early"]
    assert stopped["planned_steps"] == 120 and stopped["wall_seconds_saved"] > 0
    progress = [event for event in events if isinstance(event, Progress)]
    assert progress[-1].fraction == 1 and "the curve is flat" in progress[-1].message


def test_training_that_stops_without_a_cooldown_is_measured_at_its_end(large_scene: Scene, tmp_path: Path) -> None:
    result = run(large_scene, FLAT.changed(cooldown=0.0), tmp_path)
    assert result.figures["steps"] == result.curve[-1].step == 60 + 7 * 3
    assert result.figures["stopped_early"]["wall_seconds_saved"] > 0


def test_training_makes_every_step_without_early_stopping(large_scene: Scene, tmp_path: Path) -> None:
    result = run(large_scene, FLAT.changed(stop_when_flat=0.0), tmp_path)
    assert result.figures["steps"] == 120
    assert result.figures["stopped_early"] is None
    assert result.figures["validation_photos"] == []


def test_training_stops_early_also_where_no_photo_is_a_test_photo(large_scene: Scene, tmp_path: Path) -> None:
    views = [replace(view, held_out=False) for view in large_scene.views]
    result = run(large_scene, FLAT, tmp_path, views=views)
    assert result.figures["measured_on"] == "training photos" and result.figures["steps"] < 120


@pytest.fixture(scope="module")
def uninterrupted(large_scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> TrainingResult:
    return run(darkened(large_scene), EVERYTHING, tmp_path_factory.mktemp("uninterrupted"))


@pytest.mark.parametrize(
    "calls",
    [
        pytest.param(15, id="before the trials"),
        pytest.param(60, id="in the first trial"),
        pytest.param(165, id="in the second trial"),
        pytest.param(270, id="while flatness is checked"),
        pytest.param(281, id="when the validation photos return"),
        pytest.param(288, id="in the cooldown"),
    ],
)
def test_run_stopped_in_any_phase_resumes_exactly(
    large_scene: Scene, uninterrupted: TrainingResult, tmp_path: Path, calls: int
) -> None:
    dark = darkened(large_scene)
    with pytest.raises(Cancelled):
        run(dark, EVERYTHING, tmp_path, stop=stop_after(calls))
    resumed = run(dark, EVERYTHING, tmp_path)
    assert same(resumed.gaussians, uninterrupted.gaussians)
    for name in ("steps", "trials", "exposure"):
        assert resumed.figures[name] == uninterrupted.figures[name], name
    expected = [result.figures["stopped_early"]["expected_gain"] for result in (resumed, uninterrupted)]
    assert expected[0] == expected[1]
    # And a run that had ended is not trained further.
    assert same(run(dark, EVERYTHING, tmp_path).gaussians, uninterrupted.gaussians)


def test_expected_gain_is_the_slope_of_eight_measurements_times_the_steps_left() -> None:
    points = [CurvePoint(step, 0.0, 0.0, 20 + 0.01 * step, 0.5, 0.1, 10) for step in range(0, 90, 10)]
    points[0] = replace(points[0], psnr=0.0)
    assert expected_gain(points, 100) == pytest.approx(0.2)
    assert expected_gain(points[:7], 100) == float("inf")
