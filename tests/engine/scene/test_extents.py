"""Far Gaussians are those beyond what photos measured, wherever the scene lies; a few wrong points change nothing."""

from __future__ import annotations

import numpy as np
import pytest

from engine.scene import Camera, CameraSet, Gaussians, bottom_middle, far_gaussians


def camera_set(points: np.ndarray, centers: np.ndarray) -> CameraSet:
    cameras = []
    for number, center in enumerate(centers):
        viewmat = np.eye(4)
        viewmat[:3, 3] = -center
        cameras.append(Camera(f"{number}.jpg", 64, 48, "PINHOLE", (50.0, 50.0, 32.0, 24.0), viewmat))
    colors = np.zeros(points.shape, np.uint8)
    return CameraSet(tuple(cameras), (), points.astype(np.float32), colors, 0.5, np.eye(4), False)


def gaussians_at(means: np.ndarray, size: float) -> Gaussians:
    count = len(means)
    return Gaussians(
        means=means.astype(np.float32),
        log_scales=np.full((count, 3), np.log(size), np.float32),
        quats=np.ones((count, 4), np.float32),
        opacity_logits=np.zeros(count, np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
    )


@pytest.mark.parametrize("size", [0.01, 1.0, 200.0])
@pytest.mark.parametrize("middle", [(0, 0, 0), (30, -5, 2)])
def test_far_is_relative_to_points_and_cameras(size: float, middle: tuple[int, int, int]) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (1000, 3))
    points[:5] *= 500  # wrong matches
    centers = np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    means = np.array([[0, 0, 0], [1.2, 0, 0], [0, 0, -1.2], [1.4, 0, 0], [0, 90, 0]])
    place = np.array(middle)
    cameras = camera_set(size * points + place, size * centers + place)
    assert far_gaussians(gaussians_at(size * means + place, size * 0.01), cameras).tolist() == [False] * 3 + [True] * 2
    # One that is long in a single direction counts as a ball, as in viewers.
    long = gaussians_at(size * means + place, size * 0.01)
    long.log_scales[:2, 1] = np.log(size * 0.2)
    assert far_gaussians(long, cameras).tolist() == [False, True, False, True, True]


def test_without_sparse_points_nothing_is_far() -> None:
    cameras = camera_set(np.zeros((0, 3)), np.zeros((1, 3)))
    assert not far_gaussians(gaussians_at(np.full((4, 3), 1e6), 1e6), cameras).any()


def test_the_foot_is_the_middle_of_the_bottom_and_single_gaussians_do_not_move_it() -> None:
    rng = np.random.default_rng(0)
    means = rng.uniform((1, 2, 3), (2, 4, 7), (5000, 3)).astype(np.float32)
    means[:10] = (500, 500, -500)
    np.testing.assert_allclose(bottom_middle(means), (1.5, 3, 3), atol=0.1)
