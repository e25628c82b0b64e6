"""Initial Gaussians at the sparse points, and guesses where the photos show no points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from engine.events import Event, Warned, ignore_events
from engine.scene.camera import CameraSet, PinholeCamera
from engine.training.settings import PRESETS
from engine.training.start import guess_uncovered, start_gaussians
from engine.training.views import TrainingView

from .conftest import Scene

SETTINGS = PRESETS["test"].changed(max_gaussians=1000, background_fraction=0.2)


def wall_with_a_hole() -> tuple[TrainingView, np.ndarray]:
    """A photo, red right of the middle, of a wall at depth 3 that has sparse points left of the middle only."""
    pixels = np.zeros((60, 80, 3), np.uint8)
    pixels[:, 40:, 0] = 200
    camera = PinholeCamera(np.eye(4), np.array([[70.0, 0, 40], [0, 70, 30], [0, 0, 1]]), 80, 60)
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-1.7, 0, 60), np.linspace(-1.3, 1.3, 90)))
    return TrainingView("a.jpg", camera, pixels, None, False), np.column_stack([x, y, np.full_like(x, 3.0)])


def camera_set(points: np.ndarray) -> CameraSet:
    colors = np.full((len(points), 3), 90, np.uint8)
    return CameraSet((), (), points.astype(np.float32), colors, 0.5, np.eye(4), False)


def test_guesses_fill_uncovered_areas_behind_the_points_in_the_photos_colours() -> None:
    view, points = wall_with_a_hole()
    places, colors, scales = guess_uncovered([view], points, 100, np.random.default_rng(0))
    assert len(places) == 100
    assert (places[:, 2] >= 12).all()
    assert (places[:, 2] <= 300).all()
    assert (places[:, 0] > 0).all()
    assert np.array_equal(colors, np.tile([200.0, 0, 0], (100, 1)))
    # 100 in 40 x 60 pixels are about 5 apart.
    assert np.allclose(scales / places[:, 2] * 70, 4.9, atol=0.5)


def test_guesses_similar_to_the_points_around_them_get_their_depth() -> None:
    view, points = wall_with_a_hole()
    pixels = np.full_like(view.pixels, 120)
    pixels[:, 60:] = 200
    around = np.abs(70 * points[:, 0] / 3 + 20) > 8
    places, _, _ = guess_uncovered([replace(view, pixels=pixels)], points[around], 100, np.random.default_rng(0))
    column = 70 * places[:, 0] / places[:, 2] + 40
    assert np.allclose(places[column < 40, 2], 3.0)
    assert (places[column > 64, 2] >= 12).all()
    assert min((column < 40).sum(), (column > 64).sum()) > 10


def test_photos_full_of_points_or_without_points_get_no_guesses() -> None:
    view, points = wall_with_a_hole()
    everywhere = np.concatenate([points, points * (-1, 1, 1)])
    assert len(guess_uncovered([view], everywhere, 100, np.random.default_rng(0))[0]) <= 3
    assert len(guess_uncovered([view], points[:5], 100, np.random.default_rng(0))[0]) == 0


def test_start_holds_points_and_guesses_within_the_budget() -> None:
    view, points = wall_with_a_hole()
    some = points[np.random.default_rng(1).choice(len(points), 600, replace=False)]
    start = start_gaussians(camera_set(some), [view], SETTINGS, emit=ignore_events)
    assert len(start) == 800
    # The sparse points' sizes are bound by their own spacing; what lies far behind must cover what it is seen in.
    assert start.scales[600:].min() > start.scales[:600].max()
    assert start.features is not None
    assert np.array_equal(start.means[:600], some.astype(np.float32))
    tight = start_gaussians(camera_set(some), [view], SETTINGS.changed(max_gaussians=500), emit=ignore_events)
    assert len(tight) == 500


def test_without_points_training_starts_at_random_in_view_of_the_training_photos(scene: Scene) -> None:
    events: list[Event] = []
    start = start_gaussians(camera_set(np.empty((0, 3))), scene.views, SETTINGS, emit=events.append)
    assert len(start) == 1000
    assert [type(event) for event in events] == [Warned]


def test_held_out_photos_are_not_used() -> None:
    view, points = wall_with_a_hole()
    spoiled = replace(view, photo="b.jpg", pixels=255 - view.pixels, held_out=True)
    alone, both = (
        start_gaussians(camera_set(points[::9]), views, SETTINGS, emit=ignore_events)
        for views in ([view], [view, spoiled])
    )
    assert np.array_equal(alone.sh, both.sh)


def test_black_and_invalid_pixels_get_no_guesses() -> None:
    view, points = wall_with_a_hole()
    pixels = view.pixels.copy()
    pixels[:, 60:] = 8
    valid = np.ones((60, 80), bool)
    valid[30:] = False
    places, colors, _ = guess_uncovered(
        [replace(view, pixels=pixels, valid=valid)], points, 40, np.random.default_rng(0)
    )
    assert len(places) > 10
    assert (70 * places[:, 0] / places[:, 2] + 40 < 60).all()
    assert (70 * places[:, 1] / places[:, 2] + 30 < 30).all()
    assert (colors[:, 0] == 200).all()
