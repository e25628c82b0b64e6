"""Trials on validation photos: what gains enough is kept, and the rest is left out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from engine.core.events import Emit, Event, Progress, ignore_events, never_stop
from engine.training.held_out import render_picture
from engine.training.loop import train
from engine.training.parameters import Parameters
from engine.training.result import TrainingResult
from engine.training.schedule import Schedule
from engine.training.settings import PRESETS, TrainingSettings
from engine.training.trials import brightness_factors, exposure_corrected_quality
from engine.training.views import Level, TrainingView, ViewPyramid

from .conftest import BANDS, Scene, make_truth, shiny


def run(
    scene: Scene,
    settings: TrainingSettings,
    folder: Path,
    *,
    views: list[TrainingView] | None = None,
    emit: Emit = ignore_events,
) -> TrainingResult:
    return train(scene.start, views or scene.views, settings, checkpoints=folder, emit=emit, should_stop=never_stop)


def test_view_dependent_colours_are_used_where_photos_show_them(
    large_scene: Scene, trained_with_bands: TrainingResult, tmp_path: Path
) -> None:
    result = trained_with_bands
    first = result.figures["trials"][0]
    assert (first["what"], first["step"], first["n_steps"], first["kept"]) == ("1", 120, 60, True)
    assert first["gain"] > 0.3
    assert result.gaussians.sh.shape[1] >= 4
    untried = run(large_scene, BANDS.changed(sh_degree=0), tmp_path, views=shiny(large_scene))
    assert result.figures["psnr"] > untried.figures["psnr"] + 0.3


def test_a_trial_predicts_the_gain_of_slowly_trained_bands(large_scene: Scene, tmp_path: Path) -> None:
    result = run(large_scene, BANDS.changed(lr_sh_rest=0.00015), tmp_path, views=shiny(large_scene))
    first = result.figures["trials"][0]
    assert first["kept"] and first["gain"] > 0.3


def test_bands_are_removed_when_their_trial_fails(large_scene: Scene, tmp_path: Path) -> None:
    settings = BANDS.changed(steps=160, sh_interval=40, min_trial_gain=9.0)
    result = run(large_scene, settings, tmp_path / "two")
    # The second band is not tried where the first did not pay.
    assert [(trial["what"], trial["kept"]) for trial in result.figures["trials"]] == [("1", False)]
    assert result.gaussians.sh.shape[1] == 1
    assert result.figures["sh_degree"] == 0


def test_progress_never_falls_in_a_trial(large_scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("engine.training.loop.EVENT_INTERVAL", 0.0)
    events: list[Event] = []
    run(large_scene, BANDS.changed(steps=160, sh_interval=40, sh_degree=1), tmp_path, emit=events.append)
    progress = [event for event in events if isinstance(event, Progress)]
    shown = [event.fraction for event in progress]
    tried = [event.fraction for event in progress if "trying" in event.message]
    # Both copies make 50 steps, of 260 in all.
    assert shown == sorted(shown) and shown[-1] == 1.0 and tried[-1] - tried[0] > 0.3


def test_with_few_photos_everything_is_used_without_trial(large_scene: Scene, tmp_path: Path) -> None:
    trained = [view for view in large_scene.views if not view.held_out][:23]
    settings = BANDS.changed(steps=50, sh_interval=20)
    result = run(large_scene, settings, tmp_path, views=trained)
    assert result.figures["trials"] == []
    assert result.figures["sh_degree"] == 2


def test_trials_begin_with_their_bands_and_end_before_the_cooldown() -> None:
    settings = PRESETS["standard"].changed(steps=1000, sh_degree=3, sh_interval=250, trial_fraction=0.05, cooldown=0.1)
    trials = Schedule(settings, 28, 1.0).trials
    assert trials == {250: 1, 500: 2, 750: 3}
    assert Schedule(settings.changed(sh_interval=450), 28, 1.0).trials.keys() >= {450}
    assert 900 not in Schedule(settings.changed(sh_interval=450), 28, 1.0).trials
    assert Schedule(settings.changed(trial_fraction=0.0), 28, 1.0).trials == {}


def test_exposure_of_a_photo_does_not_count_as_error(large_scene: Scene) -> None:
    view = replace(large_scene.views[4], pixels=(large_scene.views[4].pixels * 0.5).round().astype(np.uint8))
    level = ViewPyramid([view], BANDS.features).level(0, 0)
    brighter = torch.from_numpy(large_scene.views[4].pixels).float() / 255.0
    assert brightness_factors(brighter, level).numpy() == pytest.approx(0.5, abs=0.01)
    truth, _ = make_truth()
    values = Parameters.from_gaussians(truth, sh_degree=0, features=False).values

    def picture(level: Level) -> torch.Tensor:
        return render_picture(values, level, backend="cpu", sh_degree=0)

    assert exposure_corrected_quality(picture, [level]).psnr > 40
