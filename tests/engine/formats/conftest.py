"""Fixtures: random Gaussians from a seed, and their comparison."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from engine.scene.gaussians import Gaussians


def _random_gaussians(count: int, *, degree: int = 3, seed: int = 0) -> Gaussians:
    rng = np.random.default_rng(seed)

    def normal(*shape: int) -> np.ndarray:
        return rng.standard_normal(shape, dtype=np.float32)

    return Gaussians(
        means=normal(count, 3),
        log_scales=normal(count, 3) - 3,
        quats=normal(count, 4),
        opacity_logits=4 * normal(count),
        sh=0.3 * normal(count, (degree + 1) ** 2, 3),
    )


def _assert_same_gaussians(actual: Gaussians, expected: Gaussians) -> None:
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh"):
        got, wanted = getattr(actual, name), getattr(expected, name)
        assert got.dtype == wanted.dtype == np.float32, name
        np.testing.assert_array_equal(got, wanted, err_msg=name)


@pytest.fixture
def random_gaussians() -> Callable[..., Gaussians]:
    """Return ``random_gaussians(count, degree=3, seed=0)``: quats of any length, opacities up to near 0 and 1."""
    return _random_gaussians


@pytest.fixture
def assert_same_gaussians() -> Callable[[Gaussians, Gaussians], None]:
    """Return a function that compares Gaussians bit for bit, including shapes and types."""
    return _assert_same_gaussians
