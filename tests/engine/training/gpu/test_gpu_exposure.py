"""Brightness factors of photos, and masks that change during training: as the processor's trainer has them."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from engine.rasterizer.gpu import Gpu
from engine.training import AdamState, Target, adam_step, photometric_loss
from engine.training.gpu import GpuParameters, GpuTrainer, StepPlan, StepSettings
from engine.training.losses import GpuExposures
from engine.training.parameters import render

from ...rasterizer.scenes import camera
from .test_gpu_training import RATES, arrays, assert_same_moments, photo, same, start

RATE = 0.002
VIEWS = [camera(64, 48), camera(64, 48, off_center=False), camera(50, 60)]
SETTINGS = StepSettings(lambda_exposure=0.1)
PLANS = [StepPlan(i % 3, RATES, 3, RATE, (0, 1) if i < 4 else (0, 1, 2)) for i in range(8)]


def dark(number: int) -> np.ndarray:
    """Return a photo that is darker than the image, by its number."""
    return (photo(VIEWS[number], number) * (0.5 + 0.1 * number)).astype(np.uint8)


def first_exposures() -> np.ndarray:
    return np.random.default_rng(3).normal(0.0, 0.1, (3, 3)).astype(np.float32)


def trainer_with_exposures(gpu: Gpu) -> GpuTrainer:
    trainer = GpuTrainer(
        gpu, GpuParameters(gpu, arrays(start())), SETTINGS, exposures=GpuExposures(gpu, first_exposures())
    )
    for number, view in enumerate(VIEWS):
        trainer.add_photo(view, dark(number), view=number)
    return trainer


def test_brightness_factors_are_trained_as_on_the_processor(opened_gpu: Gpu) -> None:
    trainer, cpu = trainer_with_exposures(opened_gpu), start()
    losses = trainer.steps(PLANS)
    exposure, moments = torch.from_numpy(first_exposures()), AdamState.zeros_like(torch.zeros(3, 3))
    expected = []
    for plan in PLANS:
        cpu.track()
        exposure.requires_grad_(True).grad = None
        raster = render(cpu.values, VIEWS[plan.photo], backend="cpu", sh_degree=3)
        image = raster.image[..., :3] * exposure[plan.photo].exp()
        loss = photometric_loss(image, Target(dark(plan.photo)))
        loss = loss + SETTINGS.lambda_exposure * exposure[plan.photo].square().sum()
        loss.backward()
        cpu.step(dict(plan.learning_rates))
        values, views = exposure.detach(), list(plan.centred)
        adam_step([(values, exposure.grad, RATE)], [moments])
        values[views] -= values[views].mean(dim=0)
        expected.append(loss.item())
    np.testing.assert_allclose(losses, expected, rtol=1e-5)
    # Each gradient is a sum over the picture, whose rounding is 1e-6 of it; Adam divides by its size.
    difference = np.abs(trainer.exposures.values() - exposure.detach().numpy())
    assert difference.max() <= 1e-2 * RATE
    found = trainer.exposures.moments()
    assert found.step == moments.step == len(PLANS)
    torch.testing.assert_close(found.mean, moments.mean, rtol=1e-3, atol=1e-6)
    torch.testing.assert_close(found.square, moments.square, rtol=1e-3, atol=1e-9)
    assert_same_moments(trainer, cpu)


def test_brightness_factors_of_two_runs_have_the_same_bits_and_continue_from_what_was_read(opened_gpu: Gpu) -> None:
    whole, half = trainer_with_exposures(opened_gpu), trainer_with_exposures(opened_gpu)
    losses = whole.steps(PLANS)
    before = half.steps(PLANS[:3])
    exposures = GpuExposures(opened_gpu, half.exposures.values(), half.exposures.moments())
    parameters = GpuParameters(opened_gpu, half.parameters.values(), half.parameters.moments())
    rest = GpuTrainer(opened_gpu, parameters, SETTINGS, exposures=exposures)
    for number, view in enumerate(VIEWS):
        rest.add_photo(view, dark(number), view=number)
    assert before + rest.steps(PLANS[3:]) == losses and same(rest, whole)
    assert np.array_equal(rest.exposures.values(), whole.exposures.values())


def test_steps_without_a_rate_keep_the_brightness_factors(opened_gpu: Gpu) -> None:
    trainer = trainer_with_exposures(opened_gpu)
    trainer.steps([StepPlan(1, RATES, 3)] * 2)
    assert np.array_equal(trainer.exposures.values(), first_exposures()) and trainer.exposures.step == 0


def test_mask_that_is_set_between_steps_counts_as_one_that_was_there(opened_gpu: Gpu) -> None:
    view = VIEWS[0]
    valid = np.ones((view.height, view.width), bool)
    valid[10:30, 5:40] = False
    found = []
    for late in (True, False):
        trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, arrays(start())))
        trainer.add_photo(view, dark(0), valid=~valid if late else valid)
        if late:
            trainer.mask_photo(0, valid)
        trainer.steps([StepPlan(0, RATES, 3)] * 2)
        found.append(trainer)
    assert same(*found)
    with pytest.raises(ValueError, match="leave a pixel"):
        found[0].mask_photo(0, np.zeros_like(valid))
