"""Test photos decide nothing. Validation photos decide, and are trained on once everything is decided."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import Cancelled
from engine.core.events import Event, StopCheck, ignore_events, never_stop
from engine.core.label_runs import LabelRuns
from engine.scene.gaussians import Gaussians
from engine.training.checkpoint import RunState, read_checkpoint
from engine.training.loop import train
from engine.training.result import TrainingResult
from engine.training.settings import PRESETS, TrainingSettings
from engine.training.views import TrainingView

from .conftest import BANDS, Scene, shiny

EVERYTHING = PRESETS["test"].changed(
    steps=120, grow_until=0.4, checkpoint_interval=7, sh_degree=2, sh_interval=20, transients=True, trial_fraction=0.1,
    min_trial_gain=0.0, lr_exposure=0.01,
)  # fmt: skip
"""Trials of bands at steps 20 and 40, of 50 steps each."""
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
            labels=LabelRuns.of(rng.integers(0, 4, view.pixels.shape[:2], dtype=np.int32)),
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


@pytest.fixture(scope="module")
def uninterrupted(large_scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> TrainingResult:
    return run(darkened(large_scene), EVERYTHING, tmp_path_factory.mktemp("uninterrupted"))


def test_no_pixel_of_a_test_photo_influences_the_result(
    large_scene: Scene, uninterrupted: TrainingResult, tmp_path: Path
) -> None:
    result = uninterrupted
    changed = with_noise(darkened(large_scene), lambda view: view.held_out)
    noise = run(large_scene, EVERYTHING, tmp_path, views=changed)
    assert same(noise.gaussians, result.gaussians)
    for name in ("trials", "steps", "exposure", "out_of_place", "measured_photos"):
        assert result.figures.get(name) == noise.figures.get(name), name
    assert len(result.figures["trials"]) == 2
    assert result.figures["measured_on"] == "test photos"
    assert not {*result.figures["measured_photos"]} & {*result.figures["validation_photos"]}
    # The noise is measured, and nothing like it is in the scene.
    assert noise.figures["psnr"] < result.figures["psnr"] - 5


def test_decisions_depend_on_the_validation_photos(
    large_scene: Scene, trained_with_bands: TrainingResult, tmp_path: Path
) -> None:
    # A band shows colours that change with the side they are seen from, which noise does not.
    assert trained_with_bands.figures["trials"][0]["kept"]
    assert tuple(trained_with_bands.figures["validation_photos"]) == VALIDATION
    shining = replace(large_scene, views=shiny(large_scene))
    noise = with_noise(shining, lambda view: view.photo in VALIDATION)
    refused = run(shining, BANDS, tmp_path, views=noise)
    assert [trial["kept"] for trial in refused.figures["trials"]] == [False]


def test_brightness_of_the_validation_photos_is_learned_once_they_are_trained_on(
    large_scene: Scene, tmp_path: Path
) -> None:
    settings = BANDS.changed(sh_degree=1, sh_interval=100, lr_exposure=0.01, lambda_exposure=0.0)
    result = run(darkened(large_scene), settings, tmp_path)
    factors = {name: float(np.mean(result.figures["exposure"][name])) for name in VALIDATION}
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
        state = read_checkpoint(folder)
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
    assert (figures["trials"], figures["validation_photos"]) == ([], [])
    assert figures["steps"] == 120 and figures["sh_degree"] == 2
    assert sorted(figures["exposure"]) == [view.photo for view in scene.views if not view.held_out]


STOPS = {
    "before the trials": (15, 15),
    "in the first trial": (45, 20),
    "in the second trial": (160, 40),
    "when the validation photos return": (103, 43),
    "in the cooldown": (72, 115),
}
"""Steps of trials included that a run makes until it is stopped, and where it continues: a trial begins again."""


def test_run_stopped_in_every_phase_resumes_exactly(
    large_scene: Scene, uninterrupted: TrainingResult, tmp_path: Path
) -> None:
    dark = darkened(large_scene)
    for phase, (calls, step) in STOPS.items():
        with pytest.raises(Cancelled):
            run(dark, EVERYTHING, tmp_path, stop=stop_after(calls))
        state = read_checkpoint(tmp_path)
        assert state is not None and state.step == step, phase
    resumed = run(dark, EVERYTHING, tmp_path)
    assert same(resumed.gaussians, uninterrupted.gaussians)
    for name in ("steps", "trials", "exposure"):
        assert resumed.figures[name] == uninterrupted.figures[name], name
    # And a run that had ended is not trained further.
    assert same(run(dark, EVERYTHING, tmp_path, stop=stop_after(1)).gaussians, uninterrupted.gaussians)
