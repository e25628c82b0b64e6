"""Initial Gaussians are usable for many, few, no and duplicate sparse points."""

from __future__ import annotations

import numpy as np
import pytest

from engine.core.errors import TrainingError
from engine.core.events import Event, Warned
from engine.scene.camera import PinholeCamera
from engine.scene.gaussians import Gaussians
from engine.training.initialise import InitialValues, gaussians_from_points, points_in_view


def camera(center: tuple[float, float, float]) -> PinholeCamera:
    """A 40x30 camera at `center` that looks along +y; x right, z up."""
    viewmat = np.eye(4)
    viewmat[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    viewmat[:3, 3] = -viewmat[:3, :3] @ np.array(center)
    return PinholeCamera(viewmat, np.array([[30.0, 0, 18], [0, 32, 16], [0, 0, 1]]), 40, 30)


VALUES = InitialValues(sh_degree=1, feature_dim=16)


def start(points: np.ndarray, values: InitialValues = VALUES, **options: object) -> Gaussians:
    colors = np.random.default_rng(1).integers(0, 256, (len(points), 3))
    return gaussians_from_points(points, colors, values, **{"seed": 0, "max_gaussians": 5000, **options})  # type: ignore[arg-type]


def cloud(n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, 3))


def all_finite(gaussians: Gaussians) -> bool:
    return all(np.isfinite(value).all() for value in vars(gaussians).values() if value is not None)


def test_a_gaussian_is_as_large_as_the_distance_to_its_three_neighbours() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(9.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    gaussians = start(grid * 0.25)
    assert np.allclose(gaussians.scales, 0.25)


def test_colours_of_points_are_the_colours_of_gaussians() -> None:
    colors = np.random.default_rng(2).integers(0, 256, (600, 3))
    values = InitialValues(sh_degree=2, feature_dim=None)
    gaussians = gaussians_from_points(cloud(600), colors, values, seed=0, max_gaussians=600)
    assert np.allclose(0.5 + 0.28209479 * gaussians.sh[:, 0], colors / 255, atol=1e-6)
    assert gaussians.sh.shape == (600, 9, 3)
    assert not gaussians.sh[:, 1:].any()
    assert gaussians.features is None


def test_features_start_on_the_unit_sphere_or_as_in_the_paper() -> None:
    assert np.allclose(np.linalg.norm(start(cloud(700)).features, axis=1), 1, atol=1e-6)
    paper = start(cloud(700), InitialValues(sh_degree=1, feature_dim=16, feature_init="paper")).features
    assert 1.7 < np.abs(paper).max() <= 0.5 / 0.28209479


def test_duplicate_points_and_points_that_are_not_finite_are_ignored() -> None:
    points = cloud(600)
    broken = np.concatenate([points, points[:50], [[np.nan, 0, 0], [np.inf, 0, 0]]])
    gaussians = start(broken)
    assert len(gaussians) == 600
    assert all_finite(gaussians)


def test_of_more_points_than_the_maximum_the_same_subset_is_taken_each_time() -> None:
    first, second = (start(cloud(3000), max_gaussians=1000) for _ in range(2))
    assert len(first) == 1000
    assert np.array_equal(first.means, second.means)


@pytest.mark.parametrize("n", [1, 2, 3, 40])
def test_random_points_are_added_to_few_points_with_a_warning(n: int) -> None:
    events: list[Event] = []
    gaussians = start(cloud(n), emit=events.append, cameras=[camera((0, -4, 0))])
    assert len(gaussians) == 500
    assert all_finite(gaussians)
    assert [type(event) for event in events] == [Warned]


def test_without_points_gaussians_are_placed_at_random_in_the_cameras_view() -> None:
    cameras = [camera((-1, -4, 0)), camera((1, -4, 0.5))]
    gaussians = start(np.empty((0, 3)), cameras=cameras)
    assert len(gaussians) == 5000
    assert all_finite(gaussians)


def test_without_points_and_cameras_the_advice_is_more_photos() -> None:
    with pytest.raises(TrainingError, match="photos that overlap"):
        start(np.empty((0, 3)))


def test_points_in_view_are_in_the_picture_of_their_camera() -> None:
    view = camera((0.3, -4, 0.2))
    points = points_in_view([view], 1000, np.random.default_rng(0))
    local = points @ view.viewmat[:3, :3].T + view.viewmat[:3, 3]
    pixels = local[:, :2] / local[:, 2:] * view.K[[0, 1], [0, 1]] + view.K[:2, 2]
    assert (local[:, 2] > 0).all()
    assert (pixels >= 0).all()
    assert (pixels <= (view.width, view.height)).all()


def test_coincident_and_distant_points_give_bounded_scales() -> None:
    points = np.concatenate([cloud(600) * 0.1, cloud(5, seed=3) * 1e-9, [[1e4, 0, 0]]])
    scales = start(points).scales
    assert scales.min() > 1e-4
    assert scales.max() < 1.0
