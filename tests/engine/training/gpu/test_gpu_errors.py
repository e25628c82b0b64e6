"""Errors of the pictures in the pixels of each Gaussian: those of the processor's trainer."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from engine.core.errors import NumericalError
from engine.rasterizer.gpu import Gpu
from engine.training.densify import gaussian_errors
from engine.training.gpu import GpuParameters, GpuTrainer, StepPlan, StepSettings
from engine.training.held_out import render_picture
from engine.training.losses import GpuExposures
from engine.training.views import Level

from ...rasterizer.scenes import camera
from .test_gpu_training import RATES, arrays, photo, same, start

VIEWS = [camera(64, 48), camera(60, 70), camera(64, 48, off_center=False)]


def levels() -> list[Level]:
    found = []
    for i, view in enumerate(VIEWS):
        valid = np.ones((view.height, view.width), bool)
        valid[5:20, 10 * i : 30] = False
        found.append(Level(view, photo(view, i), None, None, None if i == 1 else valid))
    return found


def new_trainer(gpu: Gpu, n_features: int, capacity: int | None = None) -> GpuTrainer:
    exposures = GpuExposures(gpu, np.full((1, 3), 0.7, np.float32))  # without effect
    parameters = GpuParameters(gpu, arrays(start(n_features=n_features)))
    trainer = GpuTrainer(
        gpu, parameters, StepSettings(unit_features=True), exposures=exposures, capacity=capacity, max_gaussians=300
    )
    for level in levels():
        trainer.add_photo(level.camera, level.pixels, valid=level.valid)
    return trainer


@pytest.mark.parametrize(("n_features", "sh_degree", "capacity"), [(0, 3, None), (5, 1, 300)])
def test_errors_of_gaussians_are_those_of_the_processor(
    n_features: int, sh_degree: int, capacity: int | None, opened_gpu: Gpu
) -> None:
    trainer = new_trainer(opened_gpu, n_features, capacity)
    expected = gaussian_errors(start(), levels(), backend="cpu", sh_degree=sh_degree)
    for _ in range(2):
        found = trainer.gaussian_errors([0, 1, 2], sh_degree)
        assert found.shape == (250,) and found.dtype == torch.float32
        # Weights of a Gaussian that hardly covers a pixel are rounded to 1e-7.
        torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)
    only = trainer.gaussian_errors([1], sh_degree)
    torch.testing.assert_close(
        only, gaussian_errors(start(), levels()[1:2], backend="cpu", sh_degree=sh_degree), rtol=1e-4, atol=1e-5
    )
    assert trainer.gaussian_errors([], sh_degree).tolist() == [0.0] * 250


@pytest.mark.parametrize("n_features", [0, 4])
def test_measuring_errors_between_steps_changes_no_bit_of_training(n_features: int, opened_gpu: Gpu) -> None:
    trainers = [new_trainer(opened_gpu, n_features) for _ in range(2)]
    for step in range(3):
        plan = StepPlan(step, RATES, 3)
        assert trainers[0].steps([plan]) == trainers[1].steps([plan])
        trainers[0].gaussian_errors([2, 1], 3)
    assert same(*trainers)


def test_errors_with_a_value_that_is_not_finite_are_refused(opened_gpu: Gpu) -> None:
    values = arrays(start())
    values["sh_dc"][7] = np.inf
    trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, values))
    trainer.add_photo(VIEWS[0], photo(VIEWS[0]))
    with pytest.raises(NumericalError, match="`sh_dc` is not finite in 1 of 250 rows"):
        trainer.gaussian_errors([0], 3)


def test_pictures_of_the_trainer_are_those_of_the_processor_also_without_photos(opened_gpu: Gpu) -> None:
    trainer = new_trainer(opened_gpu, 3, capacity=64)  # fewer pairs than are needed
    for number in range(len(VIEWS)):
        trainer.free_photo(number)
    values, view = start(n_features=3).values, camera(50, 40)
    expected = render_picture(values, Level(view, photo(view), None, None), backend="cpu", sh_degree=2)
    difference = np.abs(trainer.render(view, 2).clip(0, 1) - expected.numpy())
    assert np.quantile(difference, 0.999) <= 1e-5  # single pixels lie on thresholds
