"""Initial Gaussians at the sparse points."""

from __future__ import annotations

import numpy as np

from engine.events import Event, Warned, ignore_events
from engine.scene.camera import CameraSet
from engine.training.settings import PRESETS
from engine.training.start import start_gaussians

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
