"""Fewer Gaussians in the end: those go that no picture needs, and a run resumes exactly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from engine.core.errors import Cancelled
from engine.scene import Gaussians
from engine.training.parameters import Parameters, render
from engine.training.schedule import Schedule
from engine.training.settings import PRESETS
from engine.training.thinning import changes_by_removal, thin

from .conftest import Scene
from .test_loop import QUICK, run, same, stop_after

FEW = QUICK.changed(kept=0.3)


def changes(parameters: Parameters, scene: Scene) -> torch.Tensor:
    cameras = [view.pinhole for view in scene.views]
    generator = torch.Generator().manual_seed(0)
    return changes_by_removal(parameters.values, cameras, backend="cpu", sh_degree=0, generator=generator)


def test_estimated_change_is_that_of_the_pictures_without_the_gaussian(scene: Scene) -> None:
    parameters = Parameters.from_gaussians(scene.truth, sh_degree=0, features=False)
    found = changes(parameters, scene)

    def pictures(values: dict[str, torch.Tensor]) -> torch.Tensor:
        return torch.stack([render(values, v.pinhole, backend="cpu", sh_degree=0).image[..., :3] for v in scene.views])

    whole, ratios = pictures(parameters.values), []
    for row in range(0, 400, 20):
        logits = parameters.values["opacity_logits"].clone()
        logits[row] = -30.0
        exact = (pictures({**parameters.values, "opacity_logits": logits}) - whole).square().sum()
        ratios.append(float(found[row] / exact))
    # One is a mean of 24 squares of normal values, which deviates by 0.29 of itself, or by more where few photos show
    # it: the mean of 20 by 0.1.
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.3)


def test_what_no_photo_shows_goes_first_and_the_background_stays(scene: Scene) -> None:
    truth = scene.truth
    hidden = np.full((3, 3), 50.0, np.float32)  # behind all cameras, or far outside of their pictures
    means = np.concatenate([hidden, truth.means, hidden])

    def padded(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values[:3], values, values[:3]])

    both = Gaussians(
        means, padded(truth.log_scales), padded(truth.quats), padded(truth.opacity_logits), padded(truth.sh)
    )
    parameters = Parameters.from_gaussians(both, sh_degree=0, features=False)
    parameters.n_background = 3
    found = changes(parameters, scene)
    assert found[-3:].tolist() == [0.0, 0.0, 0.0]
    thin(parameters, found, len(truth.means) - 50)
    assert len(parameters) == len(truth.means) - 50
    assert (parameters.values["means"][:3] == 50.0).all(), "the background"
    assert (parameters.values["means"][3:] < 50.0).all()
    assert {len(moment.mean) for moment in parameters.moments.values()} == {len(parameters)}


def test_run_ends_with_the_part_of_the_gaussians_that_is_kept_and_resumes_exactly(scene: Scene, tmp_path: Path) -> None:
    whole = run(scene, FEW, tmp_path / "whole")
    assert len(whole.gaussians) == round(0.3 * FEW.growth.max_gaussians)
    removals = [round(part * FEW.schedule.steps) for part in (0.6, 0.7, 0.8)]
    for calls in (removals[0], removals[1] + 1 - removals[0]):
        with pytest.raises(Cancelled):
            run(scene, FEW, tmp_path / "stopped", stop=stop_after(calls))
    assert same(run(scene, FEW, tmp_path / "stopped").gaussians, whole.gaussians)


def test_gaussians_are_removed_by_equal_factors_and_none_is_added_afterwards() -> None:
    settings = PRESETS["standard"].changed(kept=0.125)
    schedule = Schedule(settings, 10, 1.0)
    assert schedule.thinnings == {1800: 20_000, 2100: 10_000, 2400: 5_000}
    assert schedule.gaussians_after_growth(1830, 20_000) == 20_000
    assert schedule.of_trial(1500).thinnings == {}
    assert Schedule(replace(settings, growth=PRESETS["standard"].growth), 10, 1.0).thinnings == {}
