"""Gaussians in a drawn region, and floaters, on scenes that are known exactly."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from .conftest import PACKAGE

region_selection = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.splats.region_selection")
floaters = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.splats.floaters")
sight = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.splats.sight")
scene = importlib.import_module(f"{PACKAGE}.engine.scene")
errors = importlib.import_module(f"{PACKAGE}.engine.core.errors")


def gaussians_at(means: np.ndarray, opacities: np.ndarray | None = None, scale: float = 0.05) -> object:
    count = len(means)
    opacity = np.full(count, 0.95) if opacities is None else opacities
    return scene.Gaussians(
        means=means.astype(np.float32),
        log_scales=np.full((count, 3), np.log(scale), np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        opacity_logits=np.log(opacity / (1 - opacity)).astype(np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
    )


def wall(height: float) -> np.ndarray:
    """A wall of 21 x 21 points across the view, at a distance of `height` below the eye."""
    x, y = np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-1, 1, 21))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])


def from_above() -> object:
    """A view in perspective from (0, 0, 0) along Z: 200 x 200 pixels, of 90 degrees."""
    window = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -0.01], [0, 0, 1.0, 0]], np.float64)
    return sight.Sight(200, 200, window)


CORNERS = np.array([(60, 60), (140, 60), (140, 140), (60, 140)], np.float64)


def test_region_takes_the_surface_that_is_seen_or_all_behind_it() -> None:
    gaussians = gaussians_at(np.concatenate([wall(2.0), wall(3.0)]))
    surface = region_selection.in_region(from_above(), gaussians, CORNERS, through=False)
    through = region_selection.in_region(from_above(), gaussians, CORNERS, through=True)
    front, back = surface[:441], surface[441:]
    inside = (np.abs(wall(2.0)[:, :2]) / 2.0 < 0.4).all(axis=1)
    assert np.array_equal(front, inside) and not back.any()
    assert through[:441].sum() == inside.sum() and through[441:].sum() > 100


def test_nothing_hides_what_is_behind_a_gap() -> None:
    holes = wall(2.0)[(np.abs(wall(2.0)[:, :2]) > 0.9).any(axis=1)]
    gaussians = gaussians_at(np.concatenate([holes, wall(3.0)]))
    surface = region_selection.in_region(from_above(), gaussians, CORNERS, through=False)
    assert surface[len(holes) :].sum() > 100 and not surface[: len(holes)].any()


def test_region_without_an_area_is_refused() -> None:
    for corners in (CORNERS[:2], np.zeros((0, 2)), np.tile(CORNERS[0], (5, 1))):
        with pytest.raises(errors.PromptError, match="too small"):
            region_selection.in_region(from_above(), gaussians_at(wall(2.0)), corners, through=True)


def test_floaters_are_what_is_alone_or_faint() -> None:
    rng = np.random.default_rng(4)
    ball = rng.normal(size=(2000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    alone = np.array([[3, 0, 0], [3.01, 0, 0], [0, -4, 0], [0, 0, 2.5]], np.float64)
    opacities = np.full(2004, 0.9)
    opacities[:5] = 0.01
    found = floaters.find_floaters(gaussians_at(np.concatenate([ball, alone]), opacities))
    assert found[:5].all() and found[2000:].all()
    # None of the 1,995 others on the ball.
    assert found[5:2000].sum() == 0


def test_small_and_coincident_objects_have_no_isolated_gaussians() -> None:
    assert not floaters.find_floaters(gaussians_at(np.random.default_rng(0).normal(size=(10, 3)))).any()
    assert not floaters.find_floaters(gaussians_at(np.zeros((100, 3)))).any()
