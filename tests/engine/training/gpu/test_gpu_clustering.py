"""L_CC on the card: value and gradient of the processor's, for the same sampled pixels."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from engine.rasterizer.gpu import Gpu
from engine.training import Target, photometric_loss
from engine.training.gpu import GpuParameters, GpuTrainer, StepPlan, StepSettings
from engine.training.losses import ClusteringSample, LabelledPixels, clustering_loss, labelled_pixels
from engine.training.parameters import render

from ...rasterizer.scenes import camera
from ...rasterizer.test_cpu_against_reference import relative_errors
from .test_gpu_training import RATES, arrays, photo, same, start

VIEW = camera(64, 48)
WEIGHT = 1e-3


def labels(n_segments: int) -> np.ndarray:
    """Return segments in stripes; some pixels have none."""
    x, y = np.meshgrid(np.arange(VIEW.width), np.arange(VIEW.height))
    found = 1 + (x * n_segments // VIEW.width)
    found[(x + y) % 7 == 0] = 0
    return found.astype(np.int32)


def labelled(n_segments: int) -> LabelledPixels:
    found = labelled_pixels(labels(n_segments), min_pixels=8)
    assert found is not None
    return found


def sample_of(pixels: LabelledPixels, n_samples: int, seed: int) -> ClusteringSample:
    """Return the sample that `clustering_loss` draws."""
    drawn = np.arange(len(pixels))
    if n_samples:
        drawn = torch.randint(len(pixels), (n_samples,), generator=torch.Generator().manual_seed(seed)).numpy()
    weight = WEIGHT * len(pixels) / len(drawn)
    return ClusteringSample(*pixels.at(drawn), pixels.counts.numpy(), weight)


# 40 samples leave some of 12 segments without any; 2,500 draw the same pixels several times; 0 takes all pixels.
@pytest.mark.parametrize(
    ("n_segments", "n_samples", "n_features", "detached"),
    [(2, 0, 16, False), (12, 40, 5, False), (12, 2500, 16, True), (3, 300, 1, False)],
)
def test_clustering_loss_is_that_of_the_processor(
    n_segments: int, n_samples: int, n_features: int, detached: bool, opened_gpu: Gpu
) -> None:
    settings = StepSettings(unit_features=True, detached_features=detached)
    pixels, cpu = labelled(n_segments), start(n_features=n_features)
    plans = [StepPlan(0, RATES, 3, terms=[sample_of(pixels, n_samples, seed)]) for seed in range(3)]
    trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, arrays(cpu)), settings)
    trainer.add_photo(VIEW, photo(VIEW))
    losses, expected = trainer.steps(plans), []
    for seed in range(3):
        cpu.track()
        channels = torch.nn.functional.normalize(cpu.values["features"], dim=1, eps=1e-9)
        raster = render(
            cpu.values, VIEW, backend="cpu", sh_degree=3, channels=channels, detached_channels=detached
        )  # fmt: skip
        generator = torch.Generator().manual_seed(seed)
        clustering = clustering_loss(raster.image[..., 3:], pixels, n_samples=n_samples, generator=generator)
        loss = photometric_loss(raster.image[..., :3], Target(photo(VIEW))) + WEIGHT * clustering
        assert n_features == 1 or WEIGHT * clustering.item() > 0.1 * loss.item()
        loss.backward()
        cpu.step(dict(RATES))
        expected.append(loss.item())
    np.testing.assert_allclose(losses, expected, rtol=1e-5)
    # Limits as in test_gpu_training. A single unit feature is 1 or -1, so its gradient is rounding alone.
    for name, own in trainer.parameters.moments().items():
        if name == "features" and n_features == 1:
            continue
        errors = relative_errors(own.mean, cpu.moments[name].mean)
        assert float(errors.median()) <= 1e-4 and float(errors.quantile(0.99)) <= 1e-2, name


def test_clustering_loss_of_two_runs_has_the_same_bits(opened_gpu: Gpu) -> None:
    found = []
    for _ in range(2):
        trainer = GpuTrainer(
            opened_gpu, GpuParameters(opened_gpu, arrays(start(n_features=16))), StepSettings(unit_features=True)
        )
        trainer.add_photo(VIEW, photo(VIEW))
        plans = [StepPlan(0, RATES, 3, terms=[sample_of(labelled(9), n, n)]) for n in (100, 2000, 100)]  # buffers grow
        found.append((trainer, trainer.steps(plans)))
    assert found[0][1] == found[1][1] and same(found[0][0], found[1][0])


def test_sample_that_does_not_fit_the_photo_is_refused(opened_gpu: Gpu) -> None:
    trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, arrays(start(n_features=2))))
    trainer.add_photo(VIEW, photo(VIEW))
    one = np.ones(1, np.float32)
    outside = ClusteringSample(np.array([VIEW.width * VIEW.height]), np.array([0]), one, 1.0)
    with pytest.raises(ValueError, match="outside of 64 x 48"):
        trainer.steps([StepPlan(0, RATES, 3, terms=[outside])])
    with pytest.raises(ValueError, match="segments 0 to 0"):
        ClusteringSample(np.array([0]), np.array([1]), one, 1.0)
