"""Terms of opacity, scale and rays, limits after the step, Gaussians left out: as the processor's trainer has them."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
import torch

from engine.core.errors import NumericalError
from engine.rasterizer.gpu import Gpu
from engine.training import Target, guards, photometric_loss
from engine.training.gpu import GpuParameters, GpuTrainer, StepLimits, StepPlan, StepSettings
from engine.training.losses import ray_disagreement
from engine.training.parameters import Parameters as CpuParameters
from engine.training.parameters import render

from ...rasterizer.scenes import camera
from .test_gpu_training import RATES, arrays, assert_same_moments, photo, same, start

VIEW = camera(64, 48)
LAMBDA_OPACITY = 0.3
LAMBDA_RAY = 0.5
EXTENT = 2.0
LIMITS = StepLimits(
    (0.1, 0.0, 2.0), guards.MAX_DISTANCE * EXTENT, guards.MIN_SCALE * EXTENT, guards.MAX_SCALE * EXTENT,
    guards.MAX_ASPECT, guards.MAX_LOGIT,
)  # fmt: skip


def cpu_backward(
    cpu: CpuParameters, settings: StepSettings, opacity: float, ray: float, by: np.ndarray | None = None
) -> torch.Tensor:
    """Compute the gradients of a step on the processor and return the loss, without the part that `by` belongs to."""
    cpu.track()
    channels = torch.nn.functional.normalize(cpu.values["features"], dim=1, eps=1e-9)
    opacities = cpu.values["opacity_logits"].sigmoid()
    raster = render(
        cpu.values, VIEW, backend="cpu", sh_degree=3, channels=channels, detached_channels=settings.detached_features,
        opacities=opacities,
    )  # fmt: skip
    loss = photometric_loss(raster.image[..., :3], Target(photo(VIEW)))
    loss = loss + opacity * opacities.mean()
    loss = loss + settings.lambda_scale * cpu.values["log_scales"].exp().mean()
    transmittance = raster.transmittance.detach() if settings.detached_features else raster.transmittance
    loss = loss + ray * ray_disagreement(raster.image[..., 3:], transmittance)
    total = loss if by is None else loss + (raster.image[..., 3:] * torch.from_numpy(by)).sum()
    total.backward()
    return loss.detach()


@pytest.mark.parametrize("detached", [False, True])
def test_terms_of_opacity_scale_and_rays_are_those_of_the_processor(detached: bool, opened_gpu: Gpu) -> None:
    settings = StepSettings(unit_features=True, detached_features=detached, lambda_scale=0.5)
    plan, trainers = StepPlan(0, RATES, 3, lambda_opacity=LAMBDA_OPACITY, lambda_ray=LAMBDA_RAY), []
    for _ in range(2):
        trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, arrays(start(n_features=4))), settings)
        trainer.add_photo(VIEW, photo(VIEW))
        trainers.append((trainer, trainer.steps([plan] * 3)))
    (trainer, losses), (other, again) = trainers
    assert losses == again and same(trainer, other)
    cpu, expected = start(n_features=4), []
    for _ in range(3):
        expected.append(cpu_backward(cpu, settings, LAMBDA_OPACITY, LAMBDA_RAY).item())
        cpu.step(dict(RATES))
    np.testing.assert_allclose(losses, expected, rtol=1e-5)
    assert_same_moments(trainer, cpu)
    for name, value in trainer.parameters.values().items():
        difference = np.abs(value - arrays(cpu)[name]) / RATES[name]
        assert np.median(difference) <= 2e-3 and np.quantile(difference, 0.95) <= 2e-2, name


def test_gaussians_beyond_the_limits_are_brought_back_and_counted_as_on_the_processor(opened_gpu: Gpu) -> None:
    cpu = start()
    rng = np.random.default_rng(5)
    values = arrays(cpu)
    values["log_scales"][10:60] += rng.normal(0.0, 4.0, (50, 3)).astype(np.float32)
    values["opacity_logits"][40:80] *= 20.0
    values["means"][70:90] *= 1e3
    values["quats"][85:95] *= np.float32(1e-9)
    values["quats"][95:] *= 3.0
    for name, value in values.items():
        cpu.values[name] = torch.from_numpy(value.copy())
    cpu.n_background = 20
    trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, values, n_background=20), StepSettings(limits=LIMITS))
    trainer.add_photo(VIEW, photo(VIEW))
    trainer.steps([StepPlan(0, {}, 3, limits=False)])
    assert all(np.array_equal(value, values[name]) for name, value in trainer.parameters.values().items())
    trainer.steps([StepPlan(0, {}, 3)])  # without learning rates, the limits alone change values
    counts: Counter[str] = Counter()
    guards.clamp_parameters(cpu, torch.tensor(LIMITS.center), EXTENT, counts)
    assert {name: n for name, n in trainer.guards.items() if n} == dict(counts) and min(counts.values()) > 5
    for name, value in trainer.parameters.values().items():
        # A division and a square root on a card are not rounded correctly.
        np.testing.assert_allclose(value, cpu.values[name].numpy(), rtol=2e-6, atol=1e-6, err_msg=name)


def broken_gradient(
    gpu: Gpu, rows: np.ndarray | None = None, *, everywhere: bool = False
) -> tuple[GpuTrainer, dict[str, np.ndarray], np.ndarray]:
    """Return a trainer whose features have finite gradients with squares that overflow, its values and the gradient."""
    values = arrays(start(n_features=3))
    if rows is not None:
        values = {name: np.ascontiguousarray(value[rows]) for name, value in values.items()}
    by = np.zeros((VIEW.height, VIEW.width, 3), np.float32)
    by[(slice(None),) if everywhere else (24, 32)] = 1e30
    settings = StepSettings(unit_features=True, detached_features=True)
    trainer = GpuTrainer(gpu, GpuParameters(gpu, values), settings)
    trainer.add_photo(VIEW, photo(VIEW), by_features=by)
    return trainer, values, by


def test_gaussian_whose_gradient_overflows_alone_is_left_out_of_the_step(opened_gpu: Gpu) -> None:
    trainer, values, by = broken_gradient(opened_gpu)
    trainer.steps([StepPlan(0, RATES, 3)])
    cpu, counts = start(n_features=3), Counter[str]()
    cpu_backward(cpu, trainer.settings, 0.0, 0.0, by)
    guards.step_finite_rows(cpu, lambda: cpu.step(dict(RATES)), counts)
    assert trainer.guards["gaussians_not_updated"] == counts["gaussians_not_updated"] > 0
    found, expected = trainer.parameters.values(), arrays(cpu)
    left_out = np.all(expected["features"] == values["features"], axis=1)
    left_out &= np.all(expected["means"] == values["means"], axis=1)
    for name, value in found.items():
        assert np.array_equal(value[left_out], values[name][left_out]), name
        difference = np.abs(value - expected[name]) / RATES[name]
        assert np.median(difference) <= 2e-3 and np.quantile(difference, 0.95) <= 2e-2, name
    moments = trainer.parameters.moments()
    assert all(np.isfinite(one.square.numpy()).all() for one in moments.values())


def test_steps_in_which_every_gradient_overflows_change_nothing_and_are_told(opened_gpu: Gpu) -> None:
    trainer, _, _ = broken_gradient(opened_gpu)
    trainer.steps([StepPlan(0, RATES, 3)])
    visible = np.abs(trainer.parameters.moments()["means"].mean.numpy()).sum(axis=1).argmax()
    trainer, values, _ = broken_gradient(opened_gpu, np.array([visible]), everywhere=True)
    trainer.steps([StepPlan(0, RATES, 3)] * 20)
    assert trainer.guards["refused_steps"] == 20
    with pytest.raises(NumericalError, match="no gradient of any Gaussian is finite"):
        trainer.steps([StepPlan(0, RATES, 3)])
    assert all(np.array_equal(value, values[name]) for name, value in trainer.parameters.values().items())
