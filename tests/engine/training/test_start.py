"""Initial Gaussians at the sparse points."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from engine.core.events import Event, Warned, ignore_events
from engine.scene.camera import CameraSet
from engine.training.settings import PRESETS
from engine.training.start import EmptySpace, StartPoints, start_gaussians

from .conftest import Scene

SETTINGS = PRESETS["test"].changed(max_gaussians=1000, background_fraction=0.2)


def camera_set(points: np.ndarray) -> CameraSet:
    colors = np.full((len(points), 3), 90, np.uint8)
    return CameraSet((), (), points.astype(np.float32), colors, 0.5, np.eye(4), False)


def test_training_starts_at_the_sparse_points_and_leaves_room_for_the_background(scene: Scene) -> None:
    points = np.random.default_rng(1).normal(size=(600, 3))
    start = start_gaussians(camera_set(points), scene.views, SETTINGS, emit=ignore_events)
    assert np.array_equal(start.means, points.astype(np.float32))
    assert start.features is not None
    tight = start_gaussians(camera_set(points), scene.views, SETTINGS.changed(max_gaussians=500), emit=ignore_events)
    assert len(tight) == 400


def test_without_points_training_starts_at_random_in_view_of_the_training_photos(scene: Scene) -> None:
    events: list[Event] = []
    start = start_gaussians(camera_set(np.empty((0, 3))), scene.views, SETTINGS, emit=events.append)
    assert len(start) == 800
    assert [type(event) for event in events] == [Warned]


def test_places_are_near_the_points_within_three_of_their_spacings() -> None:
    grid = np.stack(np.meshgrid(*3 * [np.arange(3.0)]), axis=-1).reshape(-1, 3)
    fine = 0.01 * grid + 10.0
    points = StartPoints(np.concatenate([grid, fine]).astype(np.float32))
    places = torch.tensor([[1.0, 1.0, 1.0], [4.5, 1.0, 1.0], [5.5, 1.0, 1.0], [10.04, 10.0, 10.0], [10.2, 10.0, 10.0]])
    assert points.near(places).tolist() == [True, True, False, True, False]


@pytest.mark.parametrize("n", [1, 2, 3])
def test_few_points_are_near_themselves(n: int) -> None:
    points = np.eye(3, dtype=np.float32)[:n]
    assert StartPoints(points).near(torch.from_numpy(points)).all()


def test_nothing_stands_nearer_to_a_camera_than_its_nearest_points_suggest() -> None:
    wall = np.stack([*np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)), np.full((9, 9), 2.0)], axis=-1)
    mistakes = np.tile([0.0, 0.0, 0.1], (4, 1))
    space = EmptySpace(np.concatenate([wall.reshape(-1, 3), mistakes]), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.5]]))
    places = torch.tensor([[0.0, 0.0, 0.7], [0.9, 0.0, 0.0], [1.3, 0.0, 0.0], [0.0, 0.0, 1.9]])
    assert space.holds(places).tolist() == [True, True, False, False]


def test_a_single_point_tells_how_near_things_are() -> None:
    space = EmptySpace(np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 3)))
    assert space.holds(torch.tensor([[0.0, 0.0, 0.5], [0.0, 0.0, 0.7]])).tolist() == [True, False]
