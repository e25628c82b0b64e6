"""Nearest Gaussians found on the card are as near as those that the processor finds, wherever the Gaussians are."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from engine.rasterizer.gpu import Gpu
from engine.training.gpu import GpuParameters, GpuTrainer, StepPlan
from engine.training.losses import nearest_neighbours

from ...rasterizer.scenes import camera
from .test_gpu_training import RATES, arrays, photo, same, start


def trainer_of(gpu: Gpu, means: np.ndarray) -> GpuTrainer:
    n = len(means)
    return GpuTrainer(gpu, GpuParameters(gpu, arrays(start(n)) | {"means": means.astype(np.float32)}))


def scene(kind: str, n: int) -> np.ndarray:
    rng = np.random.default_rng(n)
    if kind == "uniform":
        return rng.uniform(-1.0, 1.0, (n, 3))
    if kind == "grid":  # many equal distances
        side = round(n ** (1 / 3))
        return np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 3) * 0.125
    if kind == "surface":
        points = rng.normal(size=(n, 3))
        return points / np.linalg.norm(points, axis=1, keepdims=True) + [500.0, 0.0, -20.0]
    if kind == "clusters":
        centers, sizes = rng.normal(size=(30, 3)), 10.0 ** rng.uniform(-5, 0, 30)
        which = rng.integers(30, size=n)
        return centers[which] + sizes[which, None] * rng.normal(size=(n, 3))
    if kind == "tiny cluster":  # most Gaussians in a millionth of the scene, others far away
        points = rng.normal(size=(n, 3)) * np.where(np.arange(n) < n // 10, 1e4, 1e-2)[:, None]
        return points[rng.permutation(n)]
    if kind == "outliers":
        return rng.normal(size=(n, 3)) * rng.pareto(0.5, (n, 1))
    if kind == "line":
        return rng.uniform(size=(n, 1)) * [1.0, 2.0, 3.0]
    if kind == "copies":
        return rng.uniform(size=(max(1, n // 40), 3))[rng.integers(max(1, n // 40), size=n)]
    assert kind == "one place"
    return np.full((n, 3), 0.3)


def assert_nearest(found: torch.Tensor, means: np.ndarray, k: int) -> None:
    """Check that all are others, different, and as near as the nearest ones, in ascending order."""
    n, rows, points = len(means), found.numpy(), means.astype(np.float32).astype(np.float64)
    assert found.dtype == torch.int32 and rows.shape == (n, k)
    assert rows.min() >= 0 and rows.max() < n and not (rows == np.arange(n)[:, None]).any()
    ordered = np.sort(rows, axis=1)
    assert (ordered[:, 1:] != ordered[:, :-1]).all()
    distances = np.linalg.norm(points[rows] - points[:, None], axis=2)
    exact = cKDTree(points).query(points, k=k + 1)[0][:, 1:]
    # The squares of distances have an error of a few 1e-7 of float32.
    np.testing.assert_allclose(distances, exact, rtol=1e-6, atol=1e-30)


@pytest.mark.parametrize(
    "kind", ["uniform", "grid", "surface", "clusters", "tiny cluster", "outliers", "line", "copies", "one place"]
)
def test_neighbours_are_the_nearest_ones(kind: str, opened_gpu: Gpu) -> None:
    means = scene(kind, 5832)
    assert_nearest(trainer_of(opened_gpu, means).nearest_neighbours(6), means, 6)


@pytest.mark.parametrize("n", [7, 8, 9, 63, 64, 65, 513, 4097])
@pytest.mark.parametrize("k", [1, 6])
def test_neighbours_for_numbers_around_those_of_the_tree(n: int, k: int, opened_gpu: Gpu) -> None:
    means = scene("outliers", n)
    assert_nearest(trainer_of(opened_gpu, means).nearest_neighbours(k), means, k)


@pytest.mark.parametrize("n", [2, 3, 4, 5, 6])
def test_few_gaussians_repeat_their_neighbours_as_on_the_processor(n: int, opened_gpu: Gpu) -> None:
    means = scene("uniform", n)
    expected = nearest_neighbours(torch.from_numpy(means.astype(np.float32)), 6)
    assert torch.equal(trainer_of(opened_gpu, means).nearest_neighbours(6), expected)


def test_a_search_between_steps_changes_no_bit_of_training_and_sees_present_means(opened_gpu: Gpu) -> None:
    view = camera(64, 48)
    trainers = []
    for searches in (False, True):
        trainer = GpuTrainer(opened_gpu, GpuParameters(opened_gpu, arrays(start())), max_gaussians=400)
        trainer.add_photo(view, photo(view))
        for _ in range(3):
            if searches:
                assert_nearest(trainer.nearest_neighbours(5), trainer.geometry()["means"].numpy(), 5)
            trainer.steps([StepPlan(0, RATES, 3)] * 2)
        trainers.append(trainer)
    assert same(*trainers)


def test_neighbours_that_cannot_be_are_refused(opened_gpu: Gpu) -> None:
    with pytest.raises(ValueError, match="got 1 and 6"):
        trainer_of(opened_gpu, np.zeros((1, 3))).nearest_neighbours(6)
    with pytest.raises(ValueError, match="got 3 and 0"):
        trainer_of(opened_gpu, scene("uniform", 3)).nearest_neighbours(0)
