"""Windows of photos that are larger than their maps, and steps that touch the Gaussians of a window alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from engine.core.events import never_stop
from engine.training import DetailPlan, detail, tiles, train_detail
from engine.training.detail import _CpuDetailSteps
from engine.training.detail_crops import Levels

from .detail_scene import SCALE, DetailScene, detail_scene

PLAN = DetailPlan(steps=60, max_gaussians=300, window_pixels=48 * 48)


@pytest.fixture(scope="module")
def scene() -> DetailScene:
    return detail_scene()


def test_maps_of_a_window_are_those_of_its_pixels(scene: DetailScene) -> None:
    crop = scene.crops[0]
    left, top, width, height = 101, 63, 77, 40
    window = crop.window(left, top, width, height)
    part = np.s_[top : top + height, left : left + width]
    np.testing.assert_array_equal(window.pixels, crop.pixels[part])
    for name in ("compared", "inside", "shown", "known"):
        large = getattr(crop, name).repeat(SCALE, axis=0).repeat(SCALE, axis=1)
        assert np.mean(getattr(window, name) == large[part]) > 0.999, name
        assert getattr(window, name).dtype == bool
    # Of two pixels of a map, the values between them.
    large = crop.alpha.repeat(SCALE, axis=0).repeat(SCALE, axis=1)
    assert window.alpha.shape == (height, width) and np.abs(window.alpha - large[part]).mean() < 0.02
    assert crop.alpha.min() <= window.alpha.min() and window.alpha.max() <= crop.alpha.max()
    assert window.camera.K[0, 2] == crop.camera.K[0, 2] - left and (window.camera.height == height)


def test_reduced_crop_has_maps_of_its_size_without_pixels_beside_the_object(scene: DetailScene) -> None:
    crop = scene.crops[0]
    small = crop.reduced(2000)
    assert small.alpha.shape == small.pixels.shape[:2] == small.inside.shape == small.shape
    assert small.alpha.size == pytest.approx(2000, rel=0.05)
    assert small.inside.mean() < crop.inside.mean() and small.inside.any()
    assert small.camera.K[0, 0] / small.camera.width == pytest.approx(crop.camera.K[0, 0] / crop.camera.width)
    assert crop.pixels_of(crop.inside) == SCALE**2 * crop.inside.sum()


def test_steps_compare_whole_crops_then_maps_then_the_photos_own_size(scene: DetailScene) -> None:
    drawn = [Levels(scene.crops, PLAN), Levels(scene.crops, PLAN)]
    focal: list[float] = []
    for step in range(PLAN.steps):
        one, other = (levels.draw(step) for levels in drawn)
        np.testing.assert_array_equal(one.pixels, other.pixels)
        assert one.compared.any() and one.pixels.shape[:2] == one.alpha.shape == one.shape
        assert one.alpha.size <= 1.05 * PLAN.window_pixels
        focal.append(one.camera.K[0, 0] / scene.crops[0].camera.K[0, 0])
    assert max(focal[:15]) < 0.5 and set(focal[15:33]) == {1 / SCALE} and set(focal[33:]) == {1.0}


def test_tiles_cover_a_crop_or_are_spread_over_it(scene: DetailScene) -> None:
    crop = replace(scene.crops[0], shown=np.ones_like(scene.crops[0].shown))
    every = tiles(crop, 10**9, side=64)
    assert sum(one.alpha.size for one in every) == crop.shape[0] * crop.shape[1]
    few = tiles(crop, 5 * 64**2, side=64)
    assert len(few) == 5 and len({one.camera.K[0, 2] for one in few}) > 2
    assert not tiles(replace(crop, shown=np.zeros_like(crop.shown)), 10**9)


def test_gaussians_outside_of_a_window_are_caught_up(scene: DetailScene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps that touch the Gaussians of their window alone end where steps of all of them do."""
    ends, touched, small = [], [], replace(PLAN, window_pixels=24 * 24)
    for most in (0.0, 2.0):
        monkeypatch.setattr(detail, "_MOST", most)
        steps, levels = _CpuDetailSteps(scene.gaussians, scene.others, "cpu"), Levels(scene.crops, small)
        for step in range(PLAN.steps):
            crop = levels.draw(step)
            if step >= 30:
                steps.step(crop, 1.0)
                touched.append(float((steps._last == steps._done).float().mean()))
        gaussians, parents = steps.result()
        np.testing.assert_array_equal(parents, np.arange(len(scene.gaussians)))
        ends.append(gaussians)
    assert min(touched[:30]) == 1.0 and np.mean(touched[30:]) < 0.8
    for name in ("means", "log_scales", "opacity_logits", "sh"):
        before = getattr(scene.gaussians, name)
        moved = [getattr(one, name) - before for one in ends]
        difference = np.linalg.norm(moved[0] - moved[1]) / np.linalg.norm(moved[0])
        assert difference < 0.15, (name, difference)


def test_the_number_of_gaussians_ends_at_the_budget_and_repeats(scene: DetailScene) -> None:
    torch.manual_seed(3)
    results = [
        train_detail(
            scene.gaussians, scene.others, scene.crops, PLAN, backend="cpu", should_stop=never_stop,
            tell=lambda done, left: None,
        )
        for _ in range(2)
    ]  # fmt: skip
    (one, parents), (other, _) = results
    assert len(one) == len(parents) == PLAN.max_gaussians
    np.testing.assert_array_equal(one.means, other.means)
    assert scene.psnr(one) > scene.psnr(scene.gaussians) + 0.5
