"""Rays through a window meet the splats that are seen there, wherever Blender has them."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from .conftest import PACKAGE
from .test_picking import CAMERA, view_of

sight = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.splats.sight")
scene = importlib.import_module(f"{PACKAGE}.engine.scene")
errors = importlib.import_module(f"{PACKAGE}.engine.core.errors")


def ball(center: tuple[float, float, float], opacity: float = 0.98) -> object:
    return scene.Gaussians(
        means=np.array([center], np.float32),
        log_scales=np.full((1, 3), np.log(0.05), np.float32),
        quats=np.array([[1, 0, 0, 0]], np.float32),
        opacity_logits=np.array([np.log(opacity / (1 - opacity))], np.float32),
        sh=np.zeros((1, 1, 3), np.float32),
    )


def layer(name: str, gaussians: object, label: int, matrix: np.ndarray | None = None) -> object:
    place = np.eye(4) if matrix is None else matrix
    return sight.SplatLayer(name, scene.RayCaster(gaussians), place, np.array([label]), np.array([0]))


def test_ray_of_a_position_passes_the_points_seen_there_and_starts_at_the_eye() -> None:
    view = view_of(CAMERA, zoom=1.0, shift=(0.2, -0.1))
    window = sight.Sight(1000, 700, view.window_from_world)  # type: ignore[attr-defined]
    points = np.random.default_rng(2).uniform(-0.8, 0.8, (30, 3))
    for point, (x, y) in zip(points, window.positions(points), strict=True):
        origin, direction = window.ray(x, y)
        # float32 matrices, as in Blender.
        assert origin == pytest.approx(CAMERA.center, abs=1e-4)
        assert np.linalg.norm(np.cross(point - origin, direction)) < 1e-4
        assert (point - origin) @ direction > 0


def test_ray_of_a_view_without_perspective_starts_before_the_scene() -> None:
    # 4 units across, depth from -10 to 10 along -Y.
    window = sight.Sight(
        100, 100, np.array([[0.5, 0, 0, 0], [0, 0, 0.5, 0], [0, 0.1, 0, 0], [0, 0, 0, 1.0]], np.float64)
    )
    origin, direction = window.ray(75, 50)
    assert origin == pytest.approx([1, -10, 0]) and direction == pytest.approx([0, 1, 0])
    with pytest.raises(errors.CameraError, match="flattened"):
        sight.ray_through(np.zeros((4, 4)), 0.0, 0.0)


def test_what_is_in_front_is_seen_also_when_its_object_was_moved_and_scaled() -> None:
    moved = np.diag([0.5, 0.5, 0.5, 1.0])
    moved[:3, 3] = (0, 0, -1.0)
    front = layer("front", ball((0, 0, 8.0)), 0, moved)  # at (0, 0, 3) in the world
    back = layer("back", ball((0, 0, 5.0)), 1)
    for layers in ([front, back], [back, front]):
        seen = sight.seen_on_ray(layers, np.zeros(3), np.array([0, 0, 1.0]))
        assert seen.label == 0 and seen.point == pytest.approx([0, 0, 3.0])
    faint = layer("faint", ball((0, 0, 2.0), 0.3), 2)
    assert sight.seen_on_ray([faint, back], np.zeros(3), np.array([0, 0, 1.0])).label == 1
    nothing = sight.seen_on_ray([faint], np.zeros(3), np.array([1.0, 0, 0]))
    assert (nothing.label, nothing.point) == (-1, None)
    assert sight.seen_on_ray([], np.zeros(3), np.array([0, 0, 1.0])).label == -1
    with pytest.raises(errors.ObjectError, match="flat is flattened"):
        sight.seen_on_ray([layer("flat", ball((0, 0, 1)), 0, np.zeros((4, 4)))], np.zeros(3), np.ones(3))


def test_polygon_may_be_concave_and_points_behind_the_eye_are_outside() -> None:
    corners = np.array([(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)], np.float64)
    points = np.array([(2, 0.5), (2, 2), (0.5, 2), (3.5, 2), (5, 1), (np.nan, 1)])
    assert sight.inside_polygon(points, corners).tolist() == [True, False, True, True, False, False]


def test_line_is_near_a_place_exactly_where_one_of_its_points_is() -> None:
    view = view_of(CAMERA, zoom=1.0, shift=(0.2, -0.1))
    window = sight.Sight(1000, 700, view.window_from_world)  # type: ignore[attr-defined]
    rng = np.random.default_rng(3)
    # Some ends are behind the eye.
    lines = rng.uniform(-3, 3, (400, 2, 3))
    shares = np.linspace(0, 1, 20_001)[:, None]
    place = 500.0, 350.0
    near = window.may_show(lines, place, 30.0)
    for (begin, end), found in zip(lines, near, strict=True):
        seen = window.positions((1 - shares) * begin + shares * end)
        away = np.nanmin(np.abs(seen - place).max(axis=1)) if np.isfinite(seen).any() else np.inf
        # A third of a pixel lies between two of the points that are looked at.
        assert found or away > 30.0
        assert not found or away < 30.5
    assert 5 < near.sum() < 100


def test_box_is_near_all_places_that_show_a_part_of_it() -> None:
    view = view_of(CAMERA, zoom=1.0, shift=(0.2, -0.1))
    window = sight.Sight(1000, 700, view.window_from_world)  # type: ignore[attr-defined]
    corners = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.1, 0.3) for z in (0.0, 0.4)])
    inside = np.random.default_rng(4).uniform(corners.min(axis=0), corners.max(axis=0), (50, 3))
    for place in window.positions(inside):
        assert window.may_show(corners[None], tuple(place), 0.0).tolist() == [True]
    low, high = window.positions(corners).min(axis=0), window.positions(corners).max(axis=0)
    for place in ((low[0] - 8, 300.0), (high[0] + 8, 300.0), (500.0, low[1] - 8), (500.0, high[1] + 8)):
        assert window.may_show(corners[None], place, 6.0).tolist() == [False]
    behind = corners + 10.0 * (CAMERA.center - corners.mean(axis=0))
    assert window.may_show(behind[None], (500.0, 350.0), 6.0).tolist() == [False]
