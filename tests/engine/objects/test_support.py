"""What stands on something is found with its foot, and without what carries it."""

from __future__ import annotations

import numpy as np
import pytest

from engine.objects.support import horizontal_surfaces, standing
from engine.scene import Gaussians

_SPACING = 0.05


def flat_on(height: float, half: float, hole: float = 0.0) -> np.ndarray:
    """Return positions on a square of a horizontal plane, without those in a smaller square."""
    line = np.arange(-half, half + 1e-6, _SPACING)
    x, y = (one.ravel() for one in np.meshgrid(line, line))
    kept = np.maximum(np.abs(x), np.abs(y)) >= hole
    return np.stack([x, y, np.full_like(x, height)], axis=1)[kept]


def column(low: float, high: float, radius: float, hollow: float = 0.0) -> np.ndarray:
    """Return positions in an upright cylinder, without those in a narrower one."""
    line, levels = np.arange(-radius, radius + 1e-6, _SPACING), np.arange(low, high, _SPACING)
    x, y, z = (one.ravel() for one in np.meshgrid(line, line, levels))
    return np.stack([x, y, z], axis=1)[(np.hypot(x, y) <= radius + 1e-6) & (np.hypot(x, y) >= hollow)]


def scene_of(*parts: tuple[np.ndarray, bool]) -> tuple[Gaussians, list[np.ndarray]]:
    """Return opaque Gaussians, flat ones where wanted and balls elsewhere, and which of them each part has."""
    means = np.vstack([positions for positions, _ in parts]).astype(np.float32)
    n, start, members = len(means), 0, []
    scales = np.full((n, 3), _SPACING / 2, np.float32)
    for positions, is_flat in parts:
        mask = np.zeros(n, bool)
        mask[start : start + len(positions)] = True
        scales[mask, 2] *= 0.1 if is_flat else 1
        start += len(positions)
        members.append(mask)
    quats = np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1))
    opacities = np.full(n, 4, np.float32)
    return Gaussians(means, np.log(scales), quats, opacities, np.zeros((n, 1, 3), np.float32)), members


def stood(scene: Gaussians, members: np.ndarray) -> np.ndarray:
    return standing(members, horizontal_surfaces(scene), scene.means)


def test_foot_that_was_left_with_the_table_belongs_to_the_goblet() -> None:
    scene, (_, cup, foot) = scene_of(
        (flat_on(0, 1.5), True), (column(0.2, 1.2, 0.3), False), (column(0.06, 0.2, 0.15), False)
    )
    assert (stood(scene, cup) == (cup | foot)).all()


def test_foot_beside_a_splinter_that_reaches_the_table_is_added_where_outlines_show_it() -> None:
    scene, (_, cup, splinter, foot, stray) = scene_of(
        (flat_on(0, 1.5), True), (column(0.2, 1.2, 0.3), False), (np.array([[0.2, 0, 0.06]]), False),
        (column(0.06, 0.2, 0.15), False), (column(1.3, 1.4, 0.2), False),
    )  # fmt: skip
    broken, surfaces = cup | splinter, horizontal_surfaces(scene)
    assert (standing(broken, surfaces, scene.means) == broken).all()
    assert (standing(broken, surfaces, scene.means, foot | stray) == (broken | foot)).all(), "what is above is no foot"


def test_pedestal_that_was_found_with_the_ship_is_left_out() -> None:
    scene, (_, top, sides, ship) = scene_of(
        (flat_on(0, 3, hole=0.7), True), (flat_on(1, 0.6), True), (column(0.4, 0.95, 0.5, hollow=0.42), False),
        (column(1.06, 2.0, 0.35), False),
    )  # fmt: skip
    found = stood(scene, top | sides | ship)
    assert (found & ship).sum() == ship.sum() and not (found & sides).any()
    outside = np.hypot(*scene.means[:, :2].T) > 0.45
    assert not (found & top & outside).any()


@pytest.mark.parametrize("clearance", [0.6, 5.0])
def test_what_hangs_high_above_the_floor_stays_as_it_is(clearance: float) -> None:
    scene, (_, shield) = scene_of((flat_on(0, 2), True), (column(clearance, clearance + 1, 0.4), False))
    assert (stood(scene, shield) == shield).all()


def test_bottle_does_not_stand_on_its_own_shoulder() -> None:
    scene, (body, shoulder, neck) = scene_of(
        (column(0, 1, 0.4), False), (flat_on(1, 0.4), True), (column(1.06, 1.5, 0.1), False)
    )
    bottle = body | shoulder | neck
    assert (stood(scene, bottle) == bottle).all()


def test_vase_does_not_stand_on_its_own_handle() -> None:
    scene, (vase, handle) = scene_of(
        (column(0, 1, 0.3), False), (flat_on(0.4, 0.06) + np.array([0.4, 0, 0]), True)
    )  # fmt: skip
    assert (stood(scene, vase | handle) == (vase | handle)).all()


def test_sets_without_extent_or_members_stay_as_they_are() -> None:
    scene, (floor,) = scene_of((flat_on(0, 1), True))
    one = np.zeros_like(floor)
    assert not stood(scene, one).any()
    one[0] = True
    assert (stood(scene, one) == one).all()
