"""L_reg on the card: value and gradient of the processor's, for the same sampled Gaussians."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from engine.rasterizer.gpu import Gpu
from engine.training import Target, photometric_loss
from engine.training.gpu import GpuParameters, GpuTrainer, StepPlan, StepSettings
from engine.training.losses import (
    N_ANCHORS,
    N_FAR,
    N_FAR_CANDIDATES,
    NeighbourSample,
    PaperSample,
    nearest_neighbours,
    neighbour_regulariser,
    paper_regulariser,
)
from engine.training.parameters import render

from ...rasterizer.scenes import camera
from .test_gpu_training import RATES, arrays, assert_same_moments, photo, same, start

VIEW = camera(64, 48)


def sample_of(neighbours: torch.Tensor, far: float, seed: int) -> NeighbourSample:
    """Return the Gaussians that `neighbour_regulariser` draws."""
    n, generator = len(neighbours), torch.Generator().manual_seed(seed)
    anchors = torch.randint(n, (min(N_ANCHORS, n),), generator=generator)
    tries = torch.randint(n, (len(anchors), N_FAR_CANDIDATES), generator=generator)
    near = neighbours[anchors].numpy()
    return NeighbourSample(anchors.numpy(), near, tries.numpy(), N_FAR, far)


# With the last distance no Gaussian is distant, and nothing is pushed.
@pytest.mark.parametrize(
    ("n", "n_features", "unit", "far"), [(1500, 16, True, 1.0), (250, 5, False, 1.5), (250, 4, True, 1e6)]
)
def test_regulariser_of_neighbours_is_that_of_the_processor(
    n: int, n_features: int, unit: bool, far: float, opened_gpu: Gpu
) -> None:
    cpu = start(n, n_features=n_features)
    neighbours = nearest_neighbours(cpu.values["means"])
    plans = [StepPlan(0, RATES, 3, terms=[sample_of(neighbours, far, seed)]) for seed in range(3)]
    runs = []
    for _ in range(2):
        trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, arrays(cpu)), StepSettings(unit_features=unit))
        trainer.add_photo(VIEW, photo(VIEW))
        runs.append((trainer, trainer.steps(plans)))
    (trainer, losses), (other, again) = runs
    assert losses == again and same(trainer, other)
    expected = []
    for seed in range(3):
        cpu.track()
        features = cpu.values["features"]
        blended = torch.nn.functional.normalize(features, dim=1, eps=1e-9) if unit else features
        raster = render(cpu.values, VIEW, backend="cpu", sh_degree=3)
        regulariser = neighbour_regulariser(
            blended, cpu.values["means"], neighbours, far=far,
            generator=torch.Generator().manual_seed(seed),
        )  # fmt: skip
        loss = photometric_loss(raster.image, Target(photo(VIEW))) + regulariser
        loss.backward()
        cpu.step(dict(RATES))
        expected.append(loss.item())
    np.testing.assert_allclose(losses, expected, rtol=1e-5)
    assert_same_moments(trainer, cpu)


# With a subset of all Gaussians and of some, and with fewer Gaussians than are far from each anchor.
@pytest.mark.parametrize(("n", "n_subset"), [(1500, 300_000), (1500, 700), (4, 300_000)])
def test_regulariser_of_the_paper_is_that_of_the_processor(
    n: int, n_subset: int, opened_gpu: Gpu, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("engine.training.losses.paper.PAPER_SUBSET", n_subset)
    cpu, plans = start(n, n_features=5), []
    for seed in range(3):
        generator = torch.Generator().manual_seed(seed)
        subset = torch.randperm(n, generator=generator)[:n_subset]
        anchors = torch.randperm(len(subset), generator=generator)[:N_ANCHORS]
        sample = PaperSample(subset.numpy(), anchors.numpy())
        plans.append(StepPlan(0, RATES, 3, terms=[sample]))
    trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, arrays(cpu)), StepSettings(unit_features=True))
    trainer.add_photo(VIEW, photo(VIEW))
    losses = trainer.steps(plans)
    expected = []
    for seed in range(3):
        cpu.track()
        unit = torch.nn.functional.normalize(cpu.values["features"], dim=1, eps=1e-9)
        generator = torch.Generator().manual_seed(seed)
        raster = render(cpu.values, VIEW, backend="cpu", sh_degree=3)
        regulariser = paper_regulariser(unit, cpu.values["means"], generator=generator)
        loss = photometric_loss(raster.image, Target(photo(VIEW))) + regulariser
        loss.backward()
        cpu.step(dict(RATES))
        expected.append(loss.item())
    np.testing.assert_allclose(losses, expected, rtol=1e-5)
    assert_same_moments(trainer, cpu)


def test_sample_of_gaussians_that_do_not_exist_is_refused(opened_gpu: Gpu) -> None:
    cpu = start(n_features=2)
    trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, arrays(cpu)))
    trainer.add_photo(VIEW, photo(VIEW))
    one = np.array([[250]])
    with pytest.raises(ValueError, match="beyond the 250"):
        trainer.steps([StepPlan(0, RATES, 3, terms=[NeighbourSample(one[0], one, one, 1, 1.0)])])
    with pytest.raises(ValueError, match="beyond the 250"):
        trainer.steps([StepPlan(0, RATES, 3, terms=[PaperSample(one[0], np.array([0]))])])
    with pytest.raises(ValueError, match="places in a subset of 1 Gaussians"):
        PaperSample(one[0], np.array([1]))
    with pytest.raises(ValueError, match="1 anchors have neighbours"):
        NeighbourSample(one[0], one[0], one, 1, 1.0)
