"""Each measurement of the rasterizer's benchmark still fits the kernels that it calls."""

from __future__ import annotations

import pytest

from benchmarks import raster_case
from benchmarks.raster import Case

TINY = {"n": 40, "width": 48, "height": 32, "repeats": 1}


@pytest.mark.parametrize("channels", [3, 19])
def test_blending_is_measured_beside_its_arithmetic_floor(channels: int) -> None:
    times = raster_case.measure(Case("blend", channels=channels, **TINY))
    assert times["cpu_ms"] > 0 and times["floor_ms"] > 0


@pytest.mark.parametrize("what", ["cpu", "reference", "step", "parts"])
def test_the_other_cases_run(what: str) -> None:
    assert min(raster_case.measure(Case(what, **TINY)).values()) >= 0


def test_gradients_are_compared_with_float64() -> None:
    assert 0 <= raster_case.measure(Case("accuracy", **TINY))["median"] < 1e-3
