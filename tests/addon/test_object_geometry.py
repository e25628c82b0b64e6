"""What lies around an object, whatever single Gaussians lie far away."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from .conftest import PACKAGE

geometry = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.project.object_geometry")


@pytest.fixture
def vase() -> np.ndarray:
    """500 positions in a box of 0.2 x 0.2 x 0.6 that stands on z = 1."""
    rng = np.random.default_rng(0)
    return (rng.random((500, 3)) * [0.2, 0.2, 0.6] + [3.0, -2.0, 1.0]).astype(np.float32)


def test_gaussians_around_stay_and_far_ones_go(vase: np.ndarray) -> None:
    others = np.array([[3.1, -1.9, 1.9], [3.1, -1.9, 40.0], [0.0, 0.0, 0.0]], np.float32)
    is_member = np.arange(503) < 500
    near = geometry.near_object(np.concatenate([vase, others]), is_member)
    assert near[:500].all() and near[500:].tolist() == [True, False, False]


def test_member_is_never_left_out(vase: np.ndarray) -> None:
    far = np.array([[40.0, 0.0, 0.0]], np.float32)
    assert geometry.near_object(np.concatenate([vase, far]), np.ones(501, bool)).all()


def test_object_without_members_keeps_everything(vase: np.ndarray) -> None:
    assert geometry.near_object(vase, np.zeros(500, bool)).all()
