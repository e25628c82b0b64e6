"""The background: a smooth sphere behind plain, bright areas without sparse points, such as sky."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from engine.scene.camera import PinholeCamera
from engine.scene.gaussians import Gaussians
from engine.training.background import background_gaussians
from engine.training.parameters import Parameters, render
from engine.training.settings import PRESETS
from engine.training.views import TrainingView

SETTINGS = PRESETS["standard"].changed(train_features=False)
WIDTH, HEIGHT = 80, 60


def view(x: float, color: tuple[int, int, int], name: str = "a.jpg") -> TrainingView:
    """A photo of one colour from a camera at `x` on the x axis that looks along z."""
    viewmat = np.eye(4)
    viewmat[0, 3] = -x
    camera = PinholeCamera(viewmat, np.array([[70.0, 0, WIDTH / 2], [0, 70, HEIGHT / 2], [0, 0, 1]]), WIDTH, HEIGHT)
    return TrainingView(name, camera, np.full((HEIGHT, WIDTH, 3), color, np.uint8), None, False)


VIEWS = [view(-1.0, (200, 40, 40)), view(1.0, (100, 40, 40), "b.jpg")]
LEFT_WALL = np.column_stack([axis.ravel() for axis in np.meshgrid(np.linspace(-4, 0, 120), np.linspace(-3, 3, 120))])
LEFT_WALL = np.column_stack([LEFT_WALL, np.full(len(LEFT_WALL), 3.0)])


def pictured(background: Gaussians, camera: PinholeCamera) -> np.ndarray:
    values = Parameters.from_gaussians(background, sh_degree=0, features=False).values
    return 255.0 * render(values, camera, backend="cpu", sh_degree=0).image.numpy()


def test_it_shows_the_colour_of_most_photos_without_holes() -> None:
    background = background_gaussians(np.empty((0, 3)), [*VIEWS, view(0.0, (200, 40, 40), "c.jpg")], SETTINGS)
    picture = pictured(background, VIEWS[0].pinhole)[15:-15, 15:-15]
    assert np.abs(picture - (200, 40, 40)).max() < 8
    assert len(background) < SETTINGS.growth.n_background / 4


def test_it_is_behind_everything_and_alike_for_all_cameras() -> None:
    background = background_gaussians(np.empty((0, 3)), VIEWS, SETTINGS)
    assert np.linalg.norm(background.means, axis=1).min() > 30.0
    one, other = (pictured(background, camera.pinhole) for camera in VIEWS)
    assert np.abs(one - other).mean() < 6


def test_it_is_missing_near_sparse_points_and_under_masks() -> None:
    background = background_gaussians(LEFT_WALL, VIEWS[:1], SETTINGS)
    x = 70 * (background.means[:, 0] + 1) / background.means[:, 2] + WIDTH / 2
    # The wall ends at x = 63; another tenth of the picture is too near.
    assert len(background) and (x > 70).all()
    valid = np.zeros((HEIGHT, WIDTH), bool)
    assert len(background_gaussians(LEFT_WALL, [replace(VIEWS[0], valid=valid)], SETTINGS)) == 0


def test_dark_or_patterned_photos_and_held_out_ones_add_nothing() -> None:
    no_points = np.empty((0, 3))
    assert len(background_gaussians(no_points, [view(0.0, (35, 35, 35))], SETTINGS)) == 0
    stripes = VIEWS[0].pixels.copy()
    stripes[:, ::2] = 160
    assert len(background_gaussians(no_points, [replace(VIEWS[0], pixels=stripes)], SETTINGS)) == 0
    held_out = replace(view(0.0, (0, 255, 0), "d.jpg"), held_out=True)
    alone, both = (background_gaussians(LEFT_WALL, views, SETTINGS) for views in (VIEWS, [*VIEWS, held_out]))
    np.testing.assert_array_equal(alone.sh, both.sh)


def test_none_is_made_when_it_is_switched_off() -> None:
    assert len(background_gaussians(np.empty((0, 3)), VIEWS, SETTINGS.changed(background_fraction=0.0))) == 0


def test_the_sphere_is_trained_without_being_cut_to_the_limits_of_other_gaussians() -> None:
    few = SETTINGS.changed(max_gaussians=400)
    background = background_gaussians(np.empty((0, 3)), VIEWS, few)
    assert torch.tensor(background.scales).max() > 2.0 * 1.1
