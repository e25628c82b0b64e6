"""Training steps on the card: the loss, the gradients, Adam and the faults of the processor's step."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch

from engine.core.errors import NumericalError
from engine.rasterizer.gpu import Gpu
from engine.scene import Gaussians, PinholeCamera
from engine.training import Target, photometric_loss
from engine.training.gpu import GpuParameters, GpuTrainer, StepPlan, StepSettings
from engine.training.parameters import Parameters as CpuParameters
from engine.training.parameters import render

from ...rasterizer.scenes import camera, random_scene
from ...rasterizer.test_cpu_against_reference import relative_errors

RATES = {
    "means": 1e-3,
    "quats": 1e-3,
    "log_scales": 5e-3,
    "opacity_logits": 2e-2,
    "sh_dc": 5e-3,
    "sh_rest": 1e-3,
    "features": 1e-2,
}


def start(n: int = 250, *, n_features: int = 0, size: float = 0.07) -> CpuParameters:
    """Return random Gaussians in training on the processor."""
    scene = random_scene(n, n_features=n_features, size=size)
    assert scene.sh is not None
    gaussians = Gaussians(
        means=scene.means.numpy(),
        log_scales=scene.scales.log().numpy(),
        quats=scene.quats.numpy(),
        opacity_logits=scene.opacities.logit().numpy(),
        sh=scene.sh.numpy(),
        features=None if scene.channels is None else scene.channels.numpy(),
    )
    return CpuParameters.from_gaussians(gaussians, sh_degree=3, features=n_features > 0)


def arrays(parameters: CpuParameters) -> dict[str, np.ndarray]:
    return {name: value.detach().numpy().copy() for name, value in parameters.values.items()}


def assert_same_moments(trainer: GpuTrainer, cpu: CpuParameters) -> None:
    """Check that Adam's first moments agree with those of the processor."""
    for name, own in trainer.parameters.moments().items():
        errors = relative_errors(own.mean, cpu.moments[name].mean)
        assert float(errors.median()) <= 1e-4 and float(errors.quantile(0.99)) <= 1e-2, name


def photo(view: PinholeCamera, seed: int = 0) -> np.ndarray:
    """Return a smooth random picture of the camera's size."""
    rng = np.random.default_rng(seed)
    coarse = torch.from_numpy(rng.uniform(0, 255, (1, 3, 6, 8)).astype(np.float32))
    smooth = torch.nn.functional.interpolate(coarse, (view.height, view.width), mode="bicubic")[0]
    return smooth.clamp(0, 255).permute(1, 2, 0).numpy().astype(np.uint8)


def cpu_step(
    parameters: CpuParameters,
    view: PinholeCamera,
    target: Target,
    plan: StepPlan,
    settings: StepSettings,
    by_features: torch.Tensor | None = None,
) -> float:
    """Make one step with the processor's rasterizer, loss and Adam; return the loss."""
    parameters.track()
    values = parameters.values
    channels = values.get("features")
    if channels is not None and settings.unit_features:
        channels = torch.nn.functional.normalize(channels, dim=1, eps=1e-9)
    raster = render(
        values, view, backend="cpu", sh_degree=plan.sh_degree, channels=channels,
        detached_channels=settings.detached_features,
    )  # fmt: skip
    loss = photometric_loss(raster.image[..., :3], target, lambda_dssim=settings.lambda_dssim)
    total = loss if by_features is None else loss + (raster.image[..., 3:] * by_features).sum()
    total.backward()
    parameters.step(dict(plan.learning_rates))
    return loss.item()


def compare(n_steps: int, gpu: Gpu, settings: StepSettings, *, n_features: int = 0) -> dict[str, np.ndarray]:
    """Make steps on both, and return the differences of each parameter in units of its learning rate.

    The means of the gradients are compared here, because the first steps of Adam hardly depend on their sizes.
    """
    ours, cpu = start(n_features=n_features), start(n_features=n_features)
    views = [camera(81, 50), camera(81, 50, off_center=False), camera(60, 70)]
    trainer = GpuTrainer(gpu, GpuParameters(gpu, arrays(ours)), settings)
    targets, given = [], []
    for i, view in enumerate(views):
        pixels, valid = photo(view, i), np.ones((view.height, view.width), bool)
        valid[5:20, 10 * i : 30] = False
        rng = np.random.default_rng(i)
        by = 1e-4 * rng.normal(size=(view.height, view.width, n_features)).astype(np.float32) if n_features else None
        given.append(None if by is None else torch.from_numpy(by))
        targets.append(Target(pixels, valid=valid))
        assert trainer.add_photo(view, pixels, valid=valid, by_features=by) == i
    # Degree 0 keeps the moments of the other bands; later degrees use them.
    plans = [StepPlan(i % 3, RATES, min(3, i // 2)) for i in range(n_steps)]
    losses = trainer.steps(plans)
    step = partial(cpu_step, settings=settings)
    expected = [step(cpu, views[p.photo], targets[p.photo], p, by_features=given[p.photo]) for p in plans]
    np.testing.assert_allclose(losses, expected, rtol=1e-5)
    assert trainer.parameters.steps == {name: state.step for name, state in cpu.moments.items()}
    assert_same_moments(trainer, cpu)
    for name in trainer.parameters.moments():
        if cpu.moments[name].step:
            moved = np.abs(arrays(cpu)[name] - arrays(ours)[name]) / RATES[name]
            assert np.quantile(moved, 0.9) > 0.5, name
    found = trainer.parameters.values()
    return {name: np.abs(found[name] - value) / RATES[name] for name, value in arrays(cpu).items()}


# Adam moves a value by about its learning rate whatever the size of its gradient, so a gradient that is rounding noise
# (of Gaussians that nearly nothing is seen of) moves it anywhere: the limits, in learning rates, are for quantiles. The
# differences found on llvmpipe are 100 times smaller; other processors round exponentials and quotients differently.
@pytest.mark.parametrize(
    ("n_steps", "settings", "n_features"),
    [
        (1, StepSettings(), 0),
        (1, StepSettings(lambda_dssim=0.0), 5),
        (1, StepSettings(lambda_dssim=1.0, unit_features=True, detached_features=True), 5),
        (10, StepSettings(unit_features=True), 4),
        (50, StepSettings(), 0),
    ],
)
def test_steps_give_the_parameters_of_the_processor(
    n_steps: int, settings: StepSettings, n_features: int, opened_gpu: Gpu
) -> None:
    for name, differences in compare(n_steps, opened_gpu, settings, n_features=n_features).items():
        assert np.median(differences) <= 2e-3, name
        assert np.quantile(differences, 0.95) <= 2e-2, name


@pytest.mark.gpu
@pytest.mark.parametrize("n_steps", [1, 10, 50])
def test_a_card_trains_like_the_processor(n_steps: int, opened_gpu: Gpu) -> None:
    settings = StepSettings(unit_features=True)
    for name, differences in compare(n_steps, opened_gpu, settings, n_features=4).items():
        assert np.median(differences) <= 2e-3, name
        assert np.quantile(differences, 0.95) <= 2e-2, name


def trained(gpu: Gpu, n_steps: int, capacity: int | None = None, size: float = 0.07) -> tuple[GpuTrainer, list[float]]:
    views = [camera(81, 50), camera(60, 70)]
    trainer = GpuTrainer(gpu, GpuParameters(gpu, arrays(start(size=size))), capacity=capacity)
    for i, view in enumerate(views):
        trainer.add_photo(view, photo(view, i))
    return trainer, trainer.steps([StepPlan(i % 2, RATES, 3) for i in range(n_steps)])


def same(one: GpuTrainer, two: GpuTrainer) -> bool:
    values, others = one.parameters.values(), two.parameters.values()
    moments, other_moments = one.parameters.moments(), two.parameters.moments()
    return all(
        np.array_equal(values[name], others[name])
        and torch.equal(moments[name].mean, other_moments[name].mean)
        and torch.equal(moments[name].square, other_moments[name].square)
        and moments[name].step == other_moments[name].step
        for name in values
    )


def test_two_runs_of_training_give_the_same_bits(opened_gpu: Gpu) -> None:
    one, first = trained(opened_gpu, 6)
    two, second = trained(opened_gpu, 6)
    assert first == second and same(one, two)


def test_steps_that_need_larger_buffers_are_repeated_and_give_the_same_bits(opened_gpu: Gpu) -> None:
    grown, losses = trained(opened_gpu, 5, capacity=300)
    enough, expected = trained(opened_gpu, 5, capacity=100_000)
    assert grown._capacity > 300
    assert losses == expected and same(grown, enough)


def test_pictures_of_many_sizes_take_the_memory_of_one(opened_gpu: Gpu) -> None:
    def memory(sizes: list[tuple[int, int]]) -> int:
        trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, arrays(start())))
        for width, height in sizes:
            trainer.add_photo(view := camera(width, height), photo(view))
        trainer.steps([StepPlan(i, RATES, 3) for i in range(len(sizes))])
        buffers = {id(one): one.size for frame in trainer._frames.values() for one in frame.buffers.values()}
        return sum(buffers.values())

    # Each further size has a photo of its own: 4 bytes for each of its pixels.
    assert memory([(50, 81), (60, 60), (81, 50), (64, 48)]) <= memory([(81, 50)]) + 3 * 4 * 81 * 50 + 1000


def test_harmonics_beyond_the_limit_of_a_binding_give_the_same_bits(opened_gpu: Gpu) -> None:
    values, view = arrays(start(20_000, size=0.01)), camera(60, 40)
    found = []
    for gpu in (opened_gpu, replace(opened_gpu, max_binding_bytes=2 << 20)):  # the harmonics take 3.7 MiB
        trainer = GpuTrainer(gpu, GpuParameters(gpu, values), capacity=30_000)
        trainer.add_photo(view, photo(view))
        trainer.steps([StepPlan(0, RATES, 3)] * 2)
        found.append(trainer)
    assert same(*found)
    assert not np.array_equal(found[0].parameters.values()["sh_rest"][-1000:], values["sh_rest"][-1000:])


@pytest.mark.parametrize("name", ["means", "log_scales", "sh_rest", "features"])
def test_value_that_is_not_finite_changes_nothing_and_is_named(name: str, opened_gpu: Gpu) -> None:
    values = arrays(start(n_features=2))
    values[name][7] = np.nan
    view = camera(60, 40)
    trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, values))
    trainer.add_photo(view, photo(view))
    with pytest.raises(NumericalError, match=f"`{name}` is not finite in 1 of 250 rows"):
        trainer.steps([StepPlan(0, RATES, 3)] * 2)
    assert all(np.array_equal(value, values[key], equal_nan=True) for key, value in trainer.parameters.values().items())
    assert set(trainer.parameters.steps.values()) == {0}


def test_step_with_a_gradient_that_is_not_finite_is_refused_and_the_others_are_made(opened_gpu: Gpu) -> None:
    found = []
    for order in ([0, 0], [0, 1, 1, 0, 1]):
        view = camera(60, 40)
        trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, arrays(start(n_features=2))))
        trainer.add_photo(view, photo(view))
        trainer.add_photo(view, photo(view), by_features=np.full((40, 60, 2), np.inf, np.float32))
        losses = trainer.steps([StepPlan(number, RATES, 3, exposure_rate=1e-3) for number in order])
        found.append((trainer, losses))
    (expected, made), (trainer, losses) = found
    assert same(trainer, expected) and trainer.guards["refused_steps"] == 3
    assert set(trainer.parameters.steps.values()) == {2} and trainer.exposures.step == 2
    assert [losses[0], losses[3]] == made and losses[1] == losses[2] == losses[3]  # the same photo
    with pytest.raises(NumericalError, match="the gradient of the image is not finite"):
        trainer.steps([StepPlan(i, RATES, 3) for i in [1] * 10 + [0] + [1] * 10])
    assert trainer.guards["refused_steps"] == 20 and set(trainer.parameters.steps.values()) == {3}


def test_training_continues_from_moments_that_were_read_back(opened_gpu: Gpu) -> None:
    whole, _ = trained(opened_gpu, 4)
    half, _ = trained(opened_gpu, 2)
    rest = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, half.parameters.values(), half.parameters.moments()))
    for i, view in enumerate([camera(81, 50), camera(60, 70)]):
        rest.add_photo(view, photo(view, i))
    rest.steps([StepPlan(i % 2, RATES, 3) for i in range(2)])
    assert same(rest, whole)


def test_background_trains_its_features_alone(opened_gpu: Gpu) -> None:
    values, view = arrays(start(n_features=2)), camera(60, 40)
    trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, values, n_background=100))
    trainer.add_photo(view, photo(view), by_features=np.full((40, 60, 2), 1e-3, np.float32))
    trainer.steps([StepPlan(0, RATES, 3)] * 2)
    for name, value in trainer.parameters.values().items():
        kept = np.array_equal(value[:100], values[name][:100])
        assert kept == (name != "features") and not np.array_equal(value[100:], values[name][100:]), name
