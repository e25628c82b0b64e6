"""Invalid inputs are refused with a message that names them."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from engine.core.errors import CameraError, NumericalError, SettingsError
from engine.rasterizer.settings import RasterSettings
from engine.scene.camera import PinholeCamera

from .scenes import NAMES, camera, random_scene


@pytest.mark.parametrize("backend", ["cpu", "reference"])
@pytest.mark.parametrize("name", NAMES)
def test_an_input_that_is_not_finite_is_named(name: str, backend: str) -> None:
    scene = random_scene(10, n_features=2)
    getattr(scene, name)[7] = float("nan")
    with pytest.raises(NumericalError, match=f"`{name}` is not finite in 1 of 10 rows .first: row 7"):
        scene.render(camera(20, 20), backend)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_loss_that_is_not_finite_is_refused_in_the_backward_pass(bad: float) -> None:
    scene = random_scene(10).leaves(torch.float32)
    image = scene.render(camera(20, 20)).image
    upstream = torch.zeros_like(image)
    upstream[3, 4, 1] = bad
    with pytest.raises(NumericalError, match="gradient of the image is not finite in 1 block"):
        image.backward(upstream)


def test_a_camera_without_a_valid_image_is_refused() -> None:
    scene = random_scene(3)
    k = np.array([[50.0, 0, 8], [0, 50, 8], [0, 0, 1]])
    for bad in (
        PinholeCamera(np.eye(4), k, 0, 16),
        PinholeCamera(np.full((4, 4), np.nan), k, 16, 16),
        PinholeCamera(np.eye(4), k + np.array([[0, 1.0, 0], [0, 0, 0], [0, 0, 0]]), 16, 16),
    ):
        with pytest.raises(CameraError):
            scene.render(bad)


def test_shapes_that_do_not_match_are_refused() -> None:
    scene = random_scene(3)
    with pytest.raises(ValueError, match="channels"):
        random_scene(3, n_features=62).render(camera(8, 8))
    with pytest.raises(ValueError, match="sh_degree"):
        scene.render(camera(8, 8), sh_degree=4)
    with pytest.raises(ValueError, match="float32"):
        scene.leaves(torch.float64).render(camera(8, 8), "cpu")


def test_settings_out_of_bounds_are_refused() -> None:
    with pytest.raises(SettingsError, match="RasterSettings.threads` must be at least 1"):
        RasterSettings(threads=0)
    with pytest.raises(SettingsError, match="near"):
        RasterSettings(near=0.0)
