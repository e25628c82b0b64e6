"""The normalised world is upright for photos taken in any orientation, and precise far from the origin."""

from __future__ import annotations

import numpy as np
import pytest

from engine.cameras.normalise import normalised_points, normalised_viewmat, original_from_world
from engine.core.arrays import Float64

from .conftest import looking_at


def orbit(elevation: float, *, degrees: float = 360.0, count: int = 24, rolls: Float64 | None = None) -> list[Float64]:
    """Return cameras around (1, 2, 3) at distance 4."""
    target = np.array([1.0, 2.0, 3.0])
    rolls = np.zeros(count) if rolls is None else rolls
    e = np.radians(elevation)
    return [
        looking_at(target + 4.0 * np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)]), target, roll)
        for a, roll in zip(np.radians(np.linspace(0.0, degrees, count, endpoint=False)), rolls, strict=True)
    ]


def moved(viewmats: list[Float64], scale: float, rotation: Float64, shift: Float64) -> list[Float64]:
    """Return the same cameras in a world that was scaled, rotated and shifted."""
    result = []
    for viewmat in viewmats:
        center = scale * rotation @ (-viewmat[:3, :3].T @ viewmat[:3, 3]) + shift
        other = np.eye(4)
        other[:3, :3] = viewmat[:3, :3] @ rotation.T
        other[:3, 3] = -other[:3, :3] @ center
        result.append(other)
    return result


def turn(seed: int) -> Float64:
    q, r = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def tilt(similarity: Float64, up: Float64) -> float:
    """Return the angle in degrees between the world's Z and the true `up`."""
    z = similarity[:3, 2] / np.linalg.norm(similarity[:3, 2])
    return float(np.degrees(np.arccos(np.clip(z @ up, -1.0, 1.0))))


@pytest.mark.parametrize("elevation", [-30.0, 0.0, 20.0, 60.0])
@pytest.mark.parametrize("degrees", [360.0, 120.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_world_of_level_photos_is_exactly_upright(elevation: float, degrees: float, seed: int) -> None:
    rotation = turn(seed)
    viewmats = moved(orbit(elevation, degrees=degrees), 7.0, rotation, np.array([5.0, -3.0, 2.0]))
    similarity = original_from_world(viewmats, np.zeros((0, 3)))
    assert tilt(similarity, rotation @ (0.0, 0.0, 1.0)) < 1e-3
    assert np.linalg.det(similarity[:3, :3]) > 0
    target = 7.0 * rotation @ (1.0, 2.0, 3.0) + (5.0, -3.0, 2.0)
    assert np.allclose(similarity[:3, 3], target, atol=1e-3)
    assert np.cbrt(np.linalg.det(similarity[:3, :3])) == pytest.approx(28.0, rel=1e-3)


def test_hand_held_rolls_average_out() -> None:
    rolls = np.random.default_rng(3).normal(0.0, np.radians(4.0), 24)
    assert tilt(original_from_world(orbit(25.0, rolls=rolls), np.zeros((0, 3))), np.array([0.0, 0.0, 1.0])) < 2.5


def test_photos_held_upright_without_exif_do_not_tilt_the_world() -> None:
    rolls = np.where(np.arange(24) % 3 == 0, np.pi / 2, 0.0)
    assert tilt(original_from_world(orbit(25.0, rolls=rolls), np.zeros((0, 3))), np.array([0.0, 0.0, 1.0])) < 1.0


def test_photos_taken_straight_down_look_down() -> None:
    viewmats = []
    for index, (x, y) in enumerate((x, y) for x in range(4) for y in range(4)):
        angle = index * np.pi / 2
        rotation = np.array([[np.cos(angle), np.sin(angle), 0], [np.sin(angle), -np.cos(angle), 0], [0, 0, -1.0]])
        viewmat = np.eye(4)
        viewmat[:3, :3] = rotation
        viewmat[:3, 3] = -rotation @ (x, y, 5.0)
        viewmats.append(viewmat)
    points = np.random.default_rng(0).uniform((0, 0, -0.1), (3, 3, 0.1), (500, 3))
    similarity = original_from_world(viewmats, points)
    assert tilt(similarity, np.array([0.0, 0.0, 1.0])) < 1.0
    # Parallel axes do not cross: the median of the points is the origin.
    assert np.allclose(similarity[:3, 3], np.median(points, axis=0))


@pytest.mark.parametrize("with_point", [False, True])
def test_one_camera_is_enough(with_point: bool) -> None:
    points = np.array([[2.0, 2.0, 3.0]]) if with_point else np.zeros((0, 3))
    similarity = original_from_world(orbit(10.0)[:1], points)
    assert np.isfinite(similarity).all()
    assert np.linalg.det(similarity[:3, :3]) > 0


def test_a_panorama_is_centred_on_its_points() -> None:
    viewmats = [looking_at(np.zeros(3), np.array([np.cos(a), np.sin(a), 0.0])) for a in np.linspace(0, 6, 12)]
    points = np.random.default_rng(0).normal(0.0, 3.0, (300, 3))
    similarity = original_from_world(viewmats, points)
    assert np.isfinite(similarity).all()
    assert 0.1 < np.median(np.linalg.norm(normalised_points(points, similarity), axis=1)) < 100.0


def test_georeferenced_origins_keep_their_precision() -> None:
    rotation, shift = turn(5), np.array([5e5, 4.5e6, 120.0])
    local = orbit(20.0)
    viewmats = moved(local, 1.0, rotation, shift)
    points = np.random.default_rng(0).normal(0.0, 1.0, (100, 3)) + (1.0, 2.0, 3.0)
    similarity = original_from_world(viewmats, points @ rotation.T + shift)
    near = original_from_world(local, points)
    there = normalised_points(points @ rotation.T + shift, similarity)
    here = normalised_points(points, near)
    for far_view, near_view in zip(viewmats, local, strict=True):
        a, b = normalised_viewmat(far_view, similarity), normalised_viewmat(near_view, near)
        seen_far = there @ a[:3, :3].T + a[:3, 3]
        seen_near = here @ b[:3, :3].T + b[:3, 3]
        # float64 resolves 1e-9 m at 4.5e6 m; the remaining error is the float32 of the points.
        assert np.abs(seen_far - seen_near).max() < 1e-6


def test_camera_and_points_move_together() -> None:
    viewmats = moved(orbit(20.0), 9.0, turn(2), np.array([1.0, 2.0, 3.0]))
    points = np.random.default_rng(0).normal(0.0, 5.0, (50, 3))
    similarity = original_from_world(viewmats, points)
    scale = np.cbrt(np.linalg.det(similarity[:3, :3]))
    world = normalised_points(points, similarity)
    for viewmat in viewmats:
        after = normalised_viewmat(viewmat, similarity)
        before = points @ viewmat[:3, :3].T + viewmat[:3, 3]
        assert np.allclose(scale * (world @ after[:3, :3].T + after[:3, 3]), before, atol=1e-4)
        assert np.allclose(after[:3, :3] @ after[:3, :3].T, np.eye(3))
