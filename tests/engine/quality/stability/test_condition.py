"""Condition numbers of functions whose condition is known, and the error measure that uses them."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from engine.quality.stability.bounds import DEFAULT, EPS32
from engine.quality.stability.condition import sensitivities
from engine.quality.stability.measure import worst_gradient
from engine.quality.stability.rules import stack_on_one_pixel
from engine.quality.stability.scenes import ordinary_scene
from engine.quality.stability.thresholds import pixels_near_thresholds


@pytest.mark.parametrize(("power", "expected"), [(1, 1.0), (3, 3.0), (-2, 2.0)])
def test_condition_of_a_power_is_its_exponent(power: int, expected: float) -> None:
    x = torch.linspace(0.5, 2.0, 7, dtype=torch.float64)[:, None]
    sensitivity = sensitivities(lambda arrays: {"y": arrays["x"] ** power}, {"x": x})["y"]
    torch.testing.assert_close(
        sensitivity / (x**power)[:, 0].abs(), torch.full((7,), expected, dtype=torch.float64), rtol=1e-4, atol=0
    )


def test_condition_of_a_difference_grows_with_cancellation() -> None:
    inputs = {"x": torch.tensor([1.0001], dtype=torch.float64), "y": torch.tensor([1.0], dtype=torch.float64)}
    sensitivity = sensitivities(lambda arrays: {"d": (arrays["x"] - arrays["y"])[:, None]}, inputs)["d"]
    assert 1.9e4 < float(sensitivity) / 1e-4 < 2.1e4


def test_an_error_of_ten_roundings_counts_as_ten() -> None:
    truth = {"g": torch.tensor([[3.0, 4.0], [1.0, 0.0]], dtype=torch.float64)}
    ours = {"g": truth["g"] + torch.tensor([[10.0 * EPS32 * 20.0, 0.0], [0.0, 0.0]], dtype=torch.float64)}
    worst = worst_gradient(ours, truth, {"g": torch.tensor([20.0, 1.0], dtype=torch.float64)})
    assert worst.array == "g" and math.isclose(worst.ratio, 10.0, rel_tol=1e-6) and math.isclose(worst.condition, 4.0)


def test_a_gradient_that_must_be_zero_and_one_that_is_not_finite_exceed_every_bound() -> None:
    zero = {"g": torch.zeros(2, 1, dtype=torch.float64)}
    insensitive = {"g": torch.zeros(2, dtype=torch.float64)}
    for bad in (1e-20, math.nan, math.inf):
        assert worst_gradient({"g": torch.tensor([[0.0], [bad]])}, zero, insensitive).ratio > 1e9


def test_only_pixels_at_a_threshold_count_as_near_it() -> None:
    for opacity, picture, gradient in (
        (0.5, False, False),
        (1 / 255 * (1 + 2e-6), True, True),
        (1 / 255 * (1 + 2e-5), False, False),
        (0.99 * (1 - 2e-6), False, True),
        (0.99 * (1 - 2e-5), False, False),
    ):
        blend, slope = pixels_near_thresholds(stack_on_one_pixel(torch.tensor([opacity]).numpy()), DEFAULT.near)
        assert (bool(blend[0, 0]), bool(slope[0, 0])) == (picture, gradient), opacity


def test_few_pixels_of_an_ordinary_scene_are_near_a_threshold() -> None:
    blend, gradient = pixels_near_thresholds(ordinary_scene(60), DEFAULT.near)
    assert float(gradient.double().mean()) < 0.01
    wide, _ = pixels_near_thresholds(replace(ordinary_scene(60)), 0.1)
    assert int(wide.sum()) > int(blend.sum())
