"""Detail on a card is that of the processor: single steps up to rounding, whole trainings up to what draws make."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from engine.core.errors import Cancelled, EnvironmentProblem
from engine.core.events import never_stop
from engine.rasterizer.settings import Backend
from engine.scene import Gaussians
from engine.training import DetailPlan, train_detail
from engine.training.detail import _CpuDetailSteps
from engine.training.detail_crops import Levels
from engine.training.gpu import GpuDetailSteps

from ...cards import opened_for
from ..detail_scene import DetailScene, detail_scene

PLAN = DetailPlan(steps=80, max_gaussians=400, window_pixels=64 * 64)
SAME_DB = 0.3
"""Largest difference in PSNR, in dB: Gaussians to split are drawn by errors of other windows, as by another seed."""


@pytest.fixture(scope="module")
def scene() -> DetailScene:
    return detail_scene()


@pytest.fixture(scope="module")
def on_card(request: pytest.FixtureRequest, scene: DetailScene) -> tuple[Gaussians, np.ndarray]:
    """What `trained` gives on the card."""
    with pytest.MonkeyPatch.context() as patch:
        opened_for(request.node, patch)
        return trained(scene, "gpu")


def trained(scene: DetailScene, backend: Backend, **changes: Any) -> tuple[Gaussians, np.ndarray]:
    given = {"should_stop": never_stop, "tell": lambda done, left: None, **changes}
    return train_detail(scene.gaussians, scene.others, scene.crops, PLAN, backend=backend, **given)


@pytest.mark.parametrize("step", [0, 50, 79])
def test_gradients_of_a_step_are_those_of_the_processor(scene: DetailScene, step: int) -> None:
    """The mean of Adam after one step is a tenth of the gradient."""
    levels = Levels(scene.crops, PLAN)
    crop = [levels.draw(number) for number in range(step + 1)][-1]
    card = GpuDetailSteps(scene.gaussians, scene.others, scene.crops, PLAN)
    processor = _CpuDetailSteps(scene.gaussians, scene.others, "cpu")
    for steps in (card, processor):
        steps.step(crop, 1.0)
    card._flush()
    _, moments = card._trainer.download()
    for name, moment in processor._parameters.moments.items():
        if name != "parent":
            found, expected = moments[name].mean[card._n_frozen :], moment.mean
            assert float(expected.abs().max()) > 0
            error = torch.linalg.vector_norm(found - expected) / torch.linalg.vector_norm(expected)
            assert float(error) < 2e-3, (name, float(error))
            assert not bool(moments[name].mean[: card._n_frozen].any())


def test_training_is_as_good_as_on_the_processor(scene: DetailScene, on_card: tuple[Gaussians, np.ndarray]) -> None:
    results = {"cpu": trained(scene, "cpu"), "gpu": on_card}
    before = scene.psnr(scene.gaussians)
    psnr = {backend: scene.psnr(gaussians) for backend, (gaussians, _) in results.items()}
    assert psnr["cpu"] > before + 1
    assert abs(psnr["gpu"] - psnr["cpu"]) < SAME_DB, psnr
    counts = [len(gaussians) for gaussians, _ in results.values()]
    assert counts[0] == counts[1] > len(scene.gaussians)
    for gaussians, parents in results.values():
        np.testing.assert_array_equal(np.unique(parents), np.arange(len(scene.gaussians)))
        np.testing.assert_array_equal(parents[: len(scene.gaussians)], np.arange(len(scene.gaussians)))
        distance = np.linalg.norm(gaussians.means - scene.gaussians.means[parents], axis=1)
        assert np.median(distance) < 0.1


def test_no_gaussian_exceeds_the_limits_of_the_processor(
    scene: DetailScene, on_card: tuple[Gaussians, np.ndarray]
) -> None:
    gaussians, _ = on_card
    scales = np.sort(gaussians.scales, axis=1)
    assert (scales[:, 2] <= 4.001 * scales[:, 1]).all() and (scales[:, 1] <= 50.1 * scales[:, 0]).all()
    assert (np.abs(gaussians.opacity_logits) <= 8.001).all()
    low, high = scene.gaussians.means.min(axis=0), scene.gaussians.means.max(axis=0)
    assert (gaussians.means >= low - 0.02).all() and (gaussians.means <= high + 0.02).all()


def test_limits_order_the_scales_as_the_processor_does(scene: DetailScene) -> None:
    """Scales at and beyond every limit, equal ones among them."""
    rows = np.array(
        [[0, 0, 0], [3, 0, 0], [0, 3, 0], [0, 0, 3], [-9, 0, 0], [0, -9, -9], [-9, -9, 0], [9, 9, 9], [1, 2, 3]]
    )
    odd = scene.gaussians[np.arange(len(rows))]
    odd = replace(odd, log_scales=(rows + np.log(0.02)).astype(np.float32), quats=odd.quats * 3)
    joined = scene.gaussians.joined(odd)
    results = []
    for steps in (
        GpuDetailSteps(joined, scene.others, scene.crops, PLAN),
        _CpuDetailSteps(joined, scene.others, "cpu"),
    ):
        steps.step(Levels(scene.crops, PLAN).draw(0), 1e-9)
        results.append(steps.result()[0])
    np.testing.assert_allclose(results[0].log_scales, results[1].log_scales, atol=1e-5)
    np.testing.assert_allclose(results[0].quats, results[1].quats, atol=1e-5)


def test_two_runs_give_the_same_bits_also_where_buffers_grow_for_more_pairs(
    scene: DetailScene, on_card: tuple[Gaussians, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = GpuDetailSteps.__init__

    def small(self: GpuDetailSteps, *given: Any) -> None:
        made(self, *given)
        self._trainer._capacity = 32

    monkeypatch.setattr(GpuDetailSteps, "__init__", small)
    again = trained(scene, "gpu")[0]
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(again, name), getattr(on_card[0], name))


def test_a_cancel_ends_it_and_a_full_card_is_told(scene: DetailScene, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[float] = []
    with pytest.raises(Cancelled, match="nothing was stored"):
        trained(scene, "gpu", tell=lambda done, left: told.append(done), should_stop=lambda: len(told) > 1)
    monkeypatch.setattr("engine.rasterizer.gpu.workspace.free_memory", lambda: 1000)
    with pytest.raises(EnvironmentProblem, match="--device cpu"):
        trained(scene, "gpu")
