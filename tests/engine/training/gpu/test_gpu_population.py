"""Random walk, dropout, and Gaussians that the processor changes between steps: relocated, added, cut."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from engine.rasterizer.gpu import Gpu
from engine.training import AdamState, Target, photometric_loss
from engine.training.densify import MAX_RAISED_OPACITY, MAX_WALK, drop, grow, position_noise, relocate
from engine.training.gpu import Dropout, GpuParameters, GpuTrainer, PositionNoise, StepPlan, StepSettings
from engine.training.parameters import Parameters as CpuParameters
from engine.training.parameters import render

from ...rasterizer.scenes import camera
from .test_gpu_training import RATES, arrays, assert_same_moments, cpu_step, photo, same, start

VIEW = camera(64, 48)
RATE, STRENGTH, EXTENT = 1e-3, 5e5, 2.0


def walk(seed: int, step: int) -> PositionNoise:
    return PositionNoise(RATE * STRENGTH / EXTENT, MAX_WALK, seed, step)


def philox(counter: np.ndarray, key: tuple[int, int]) -> np.ndarray:
    """Return the four words [N, 4] of Philox-4x32-10 for counters [N, 4], from 64-bit products."""
    a, b, c, d = counter.astype(np.uint64).T
    k0, k1 = np.uint64(key[0]), np.uint64(key[1])
    low = np.uint64(0xFFFFFFFF)
    for _ in range(10):
        first, second = np.uint64(0xD2511F53) * a, np.uint64(0xCD9E8D57) * c
        a, b, c, d = (second >> np.uint64(32)) ^ b ^ k0, second & low, (first >> np.uint64(32)) ^ d ^ k1, first & low
        k0, k1 = (k0 + np.uint64(0x9E3779B9)) & low, (k1 + np.uint64(0xBB67AE85)) & low
    return np.stack([a, b, c, d], axis=1).astype(np.uint32)


def normals(n: int, seed: int, step: int) -> np.ndarray:
    """Return the draws [n, 3] of noise.wgsl in float64."""
    counter = np.zeros((n, 4), np.uint32)
    counter[:, 0], counter[:, 1], counter[:, 2] = np.arange(n), step, 5
    u = ((philox(counter, (seed, 0)) >> 9) + 0.5) * 2.0**-23
    first, second = np.sqrt(-2.0 * np.log(u[:, 0])), np.sqrt(-2.0 * np.log(u[:, 2]))
    angle, other = 2.0 * np.pi * u[:, 1], 2.0 * np.pi * u[:, 3]
    return np.column_stack([first * np.cos(angle), first * np.sin(angle), second * np.cos(other)])


def test_generator_of_the_tests_gives_the_published_numbers() -> None:
    # Known answers of Random123 for all bits 0 and all bits 1.
    zeros, ones = np.zeros((1, 4), np.uint32), np.full((1, 4), 0xFFFFFFFF, np.uint32)
    assert philox(zeros, (0, 0)).tolist() == [[0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]]
    assert philox(ones, (0xFFFFFFFF,) * 2).tolist() == [[0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]]


def test_transparent_gaussians_walk_as_on_the_processor_by_draws_of_seed_step_and_index(
    opened_gpu: Gpu, monkeypatch: pytest.MonkeyPatch
) -> None:
    n, seed, step = 2000, 7, 123
    cpu = start(n)
    logits = np.random.default_rng(1).uniform(-8.0, 2.0, n).astype(np.float32)
    cpu.values["opacity_logits"] = torch.from_numpy(logits)
    before = arrays(cpu)
    found = []
    for _ in range(2):
        trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, before), capacity=30_000)
        trainer.add_photo(VIEW, photo(VIEW))
        trainer.steps([StepPlan(0, {}, 0, noise=walk(seed, step))])
        found.append(trainer)
    assert same(*found)
    moving = torch.from_numpy(logits).sigmoid() < 0.2
    eta = torch.from_numpy(normals(n, seed, step).astype(np.float32))[moving]
    monkeypatch.setattr("engine.training.densify.torch.randn", lambda *_, **__: eta)
    position_noise(cpu, learning_rate=RATE, extent=EXTENT, strength=STRENGTH, generator=torch.Generator())
    walked = (cpu.values["means"].numpy() - before["means"])[moving.numpy()]
    ours = (found[0].parameters.values()["means"] - before["means"])[moving.numpy()]
    length = np.linalg.norm(walked, axis=1)
    assert (length > 1e-3).sum() > 300
    # Means of size 3 are rounded to 2e-7; sines and cosines on a card may be wrong by 5e-4 (WGSL), on llvmpipe by 1e-6.
    error = np.linalg.norm(ours - walked, axis=1)
    assert np.median(error) <= 1e-6 and error.max() <= 1e-3 * length.max() + 1e-6
    still = ~moving.numpy()
    values = found[0].parameters.values()
    assert np.array_equal(values["means"][still], before["means"][still])
    assert all(np.array_equal(values[name], before[name]) for name in values if name != "means")


@pytest.mark.parametrize("size", [0.07, 0.2])
def test_gaussians_are_left_out_of_a_picture_as_on_the_processor(
    size: float, opened_gpu: Gpu, monkeypatch: pytest.MonkeyPatch
) -> None:
    lambda_opacity, seed = 0.3, 11
    cpu = start(size=size)
    cpu.values["opacity_logits"][:60] = torch.linspace(1.0, 9.0, 60)  # some reach the largest opacity
    cpu.n_background = 20
    values = arrays(cpu)
    runs = []
    for _ in range(2):
        trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, values, n_background=20))
        trainer.add_photo(VIEW, photo(VIEW))
        plans = [
            StepPlan(0, RATES, 3, lambda_opacity=lambda_opacity, dropout=Dropout(0.4, MAX_RAISED_OPACITY, seed, step))
            for step in range(3)
        ]
        runs.append((trainer, trainer.steps(plans)))
    (trainer, losses), (other, again) = runs
    assert losses == again and same(trainer, other)
    expected = []
    for step in range(3):
        counter = np.zeros((len(cpu), 4), np.uint32)
        counter[:, 0], counter[:, 1], counter[:, 2] = np.arange(len(cpu)), step, 6
        draws = torch.from_numpy(((philox(counter, (seed, 0))[:, 0] >> 8) * 2.0**-24).astype(np.float32))
        monkeypatch.setattr("engine.training.densify.torch.rand", lambda *_, draws=draws, **__: draws)
        cpu.track()
        opacities = cpu.values["opacity_logits"].sigmoid()
        rendered = drop(opacities, 0.4, n_background=20, generator=torch.Generator())
        assert 50 < int((rendered == 0.0).sum()) < 150
        raster = render(cpu.values, VIEW, backend="cpu", sh_degree=3, opacities=rendered)
        loss = photometric_loss(raster.image, Target(photo(VIEW))) + lambda_opacity * opacities.mean()
        loss.backward()
        cpu.step(dict(RATES))
        expected.append(loss.item())
    np.testing.assert_allclose(losses, expected, rtol=1e-5)
    assert_same_moments(trainer, cpu)


def test_walks_of_other_steps_and_seeds_differ_and_are_normally_distributed(opened_gpu: Gpu) -> None:
    n = 4000
    values = arrays(start(n))
    values["opacity_logits"][:] = -7.0
    values["log_scales"][:] = np.log(0.001)
    walks = []
    for seed, step in ((1, 1), (1, 2), (2, 1)):
        trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, values))
        trainer.add_photo(VIEW, photo(VIEW))
        trainer.steps([StepPlan(0, {}, 0, noise=walk(seed, step))])
        moved = trainer.parameters.values()["means"].astype(np.float64) - values["means"]
        walks.append(moved / moved.std())
    for one, two in ((0, 1), (0, 2), (1, 2)):
        # 12,000 pairs: the correlation of independent draws has a deviation of 0.009.
        assert abs(np.corrcoef(walks[one].ravel(), walks[two].ravel())[0, 1]) < 0.04
    assert abs(walks[0].mean()) < 0.04 and abs((walks[0] ** 4).mean() - 3.0) < 0.3


def test_training_continues_with_gaussians_that_the_processor_relocated_and_added(opened_gpu: Gpu) -> None:
    cpu_start = start(n_features=4)
    cpu_start.values["opacity_logits"][30:60] = -6.0
    trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, arrays(cpu_start)), StepSettings(unit_features=True))
    trainer.add_photo(VIEW, photo(VIEW))
    trainer.steps([StepPlan(0, RATES, 3)] * 2)
    cpu = CpuParameters(*trainer.download())
    generator = torch.Generator().manual_seed(0)
    assert relocate(cpu, generator=generator) >= 25
    grow(cpu, cpu.values["opacity_logits"].sigmoid(), 40, generator=generator)
    trainer.upload(cpu.values, cpu.moments)
    assert trainer.parameters.n == 290
    plan, target = StepPlan(0, RATES, 3), Target(photo(VIEW))
    losses = trainer.steps([plan] * 3)
    expected = [cpu_step(cpu, VIEW, target, plan, trainer.settings) for _ in range(3)]
    np.testing.assert_allclose(losses, expected, rtol=1e-5)
    assert_same_moments(trainer, cpu)
    for name, own in trainer.parameters.moments().items():
        assert own.step == cpu.moments[name].step


def test_download_and_upload_change_no_bit_of_training(opened_gpu: Gpu) -> None:
    trainers = []
    for copies in (True, False):
        trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, arrays(start(n_features=4))))
        trainer.add_photo(VIEW, photo(VIEW))
        trainer.steps([StepPlan(0, RATES, 2)])
        if copies:
            trainer.upload(*trainer.download())
        trainer.steps([StepPlan(0, RATES, 3)] * 2)
        trainers.append(trainer)
    assert same(*trainers)


def test_bands_that_the_processor_cut_are_gone_and_other_features_are_refused(opened_gpu: Gpu) -> None:
    trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, arrays(start())))
    trainer.add_photo(VIEW, photo(VIEW))
    trainer.steps([StepPlan(0, RATES, 1)])
    cpu = CpuParameters(*trainer.download())
    cpu.cut_sh(1)
    trainer.upload(cpu.values, cpu.moments)
    trainer.steps([StepPlan(0, RATES, 1)])
    assert trainer.parameters.values()["sh_rest"].shape == (250, 3, 3)
    features = torch.zeros(250, 2)
    with pytest.raises(ValueError, match="have 0 features, got 2"):
        trainer.upload(
            {**cpu.values, "features": features}, {**cpu.moments, "features": AdamState.zeros_like(features)}
        )
