"""Which Gaussians a view draws, and in which order."""

from __future__ import annotations

import numpy as np
import pytest
from gaussian_heritage_without_blender.gaussian_heritage_addon.splats.splat_order import (  # type: ignore[import-not-found]
    View,
    draw_order,
    mean_areas,
    visible_radii,
)

VIEW = View((2.0, 2.0), (0.0, 0.0), True)


def order(centers: list[tuple[float, float, float]], **known: object) -> list[int]:
    count = len(centers)
    arguments: dict[str, object] = {
        "radii": np.full(count, 0.01, np.float32),
        "weights": np.ones(count, np.float32),
        "view": VIEW,
        "members": np.ones(count, bool),
        **known,
    }
    rows: list[int] = draw_order(np.array(centers, np.float32), **arguments).tolist()
    return rows


def test_the_farthest_is_drawn_first() -> None:
    assert order([(0, 0, -1), (0, 0, -3), (0, 0, -2)]) == [1, 2, 0]


def test_what_is_behind_the_camera_or_beside_the_view_is_not_drawn() -> None:
    # At depth 1, the view reaches from -0.5 to 0.5.
    assert order([(0, 0, 1), (0, 0, -1), (0.7, 0, -1), (0, -0.7, -1), (0.49, 0.49, -1)]) in ([1, 4], [4, 1])
    assert order([(0.7, 0, -1)], radii=np.array([0.3], np.float32)) == [0]


def test_a_shifted_lens_shows_the_other_side() -> None:
    # Blender's window matrix adds the shift times z to x, which is negative: the view moves to the right.
    shifted = View((2.0, 2.0), (0.5, 0.0), True)
    assert order([(0.7, 0, -1), (-0.45, 0, -1)], view=shifted) == [0]


def test_without_perspective_the_view_is_a_box() -> None:
    box = View((0.1, 0.1), (0.0, 0.0), False)
    assert order([(9, 9, -50), (9, 11, -50), (0, 0, 50)], view=box) == [0, 2]


def test_a_share_keeps_what_covers_most_of_the_picture() -> None:
    weights = np.array([1, 2, 10, 3], np.float32)
    # The third is the largest, but ten times as far: 10 / 10 = 1.
    centers = [(0, 0, -1.0), (0, 0, -1.1), (0, 0, -10), (0, 0, -1.2)]
    assert order(centers, weights=weights, share=0.5) == [3, 1]
    assert len(order(centers, weights=weights, share=0.01)) == 1


def test_others_than_members_are_not_drawn() -> None:
    assert order([(0, 0, -1), (0, 0, -2)], members=np.array([False, True])) == [1]


def test_the_mean_area_is_that_of_the_shadow_over_all_directions() -> None:
    scales = np.array([[2, 2, 2], [2, 2, 1e-6], [2, 1, 0.5]], np.float32)
    directions = np.random.default_rng(0).standard_normal((20_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for (a, b, c), area in zip(scales.astype(float), mean_areas(scales), strict=True):
        shadows = np.pi * np.sqrt(((directions * (b * c, a * c, a * b)) ** 2).sum(axis=1))
        # The error of Thomsen's formula is at most 1.1 %, that of the sampling 0.4 %.
        assert area == pytest.approx(shadows.mean(), rel=0.015)


def test_a_gaussian_is_visible_as_far_as_its_density_reaches_a_grey_level() -> None:
    radius = visible_radii(np.array([[1, 3, 2]], np.float32), np.array([0.8], np.float32))[0]
    assert 0.8 * np.exp(-0.5 * (radius / 3) ** 2) == pytest.approx(1 / 255, rel=1e-4)
    assert visible_radii(np.ones((1, 3), np.float32), np.array([0.001], np.float32))[0] == 0
