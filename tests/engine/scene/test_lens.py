"""A direction has the pixel that COLMAP computes, for every lens model of COLMAP."""

from __future__ import annotations

import numpy as np
import pycolmap
import pytest
from numpy.typing import NDArray

from engine.core import errors
from engine.scene import lens
from engine.scene.camera import Camera

# All different, so that the test detects exchanged coefficients.
PARAMETERS = {
    "SIMPLE_PINHOLE": (610.0, 390.0, 310.0),
    "PINHOLE": (610.0, 590.0, 390.0, 310.0),
    "SIMPLE_RADIAL": (610.0, 390.0, 310.0, -0.08),
    "RADIAL": (610.0, 390.0, 310.0, -0.09, 0.03),
    "OPENCV": (610.0, 590.0, 390.0, 310.0, -0.09, 0.03, 0.004, -0.007),
    "FULL_OPENCV": (610.0, 590.0, 390.0, 310.0, -0.09, 0.03, 0.004, -0.007, 0.01, 0.05, 0.02, 0.01),
    "SIMPLE_FISHEYE": (610.0, 390.0, 310.0),
    "FISHEYE": (610.0, 590.0, 390.0, 310.0),
    "SIMPLE_RADIAL_FISHEYE": (610.0, 390.0, 310.0, 0.05),
    "RADIAL_FISHEYE": (610.0, 390.0, 310.0, 0.05, -0.02),
    "OPENCV_FISHEYE": (610.0, 590.0, 390.0, 310.0, 0.05, -0.02, 0.01, -0.003),
    "THIN_PRISM_FISHEYE": (610.0, 590.0, 390.0, 310.0, 0.05, -0.02, 0.004, -0.007, 0.01, -0.003, 0.002, -0.003),
    "RAD_TAN_THIN_PRISM_FISHEYE": (
        610.0, 590.0, 390.0, 310.0, 0.05, -0.02, 0.01, -0.003, 0.002, 0.001, 0.004, -0.007, 0.002, -0.003, 0.001, 0.005,
    ),
    "FOV": (610.0, 590.0, 390.0, 310.0, 0.7),
    "SIMPLE_DIVISION": (610.0, 390.0, 310.0, -0.1),
    "DIVISION": (610.0, 590.0, 390.0, 310.0, -0.1),
    "EUCM": (610.0, 590.0, 390.0, 310.0, 0.55, 1.1),
}  # fmt: skip


def camera_of(model: str, params: tuple[float, ...] | None = None) -> Camera:
    return Camera("a.jpg", 800, 600, model, params or PARAMETERS[model], np.eye(4))


def test_every_model_is_compared() -> None:
    known = set(pycolmap.CameraModelId.__members__) - {"INVALID", "EQUIRECTANGULAR"}
    assert known <= set(PARAMETERS) and set(lens._MODELS) == set(PARAMETERS)


def colmap_pixels(camera: Camera, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    lens = pycolmap.Camera(model=camera.model, width=camera.width, height=camera.height, params=list(camera.params))
    return lens.img_from_cam(np.concatenate([directions, np.ones((len(directions), 1))], axis=1))


MODELS = [name for name in PARAMETERS if name in pycolmap.CameraModelId.__members__]


@pytest.mark.parametrize("model", MODELS)
def test_pixel_is_colmaps(model: str) -> None:
    rng = np.random.default_rng(0)
    directions = np.concatenate([rng.uniform(-0.7, 0.7, (200, 2)), [[0.0, 0.0]]])
    expected = colmap_pixels(camera_of(model), directions)
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(lens.photo_pixels(camera_of(model), directions), expected, atol=1e-6)


@pytest.mark.parametrize("model", ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"])
def test_polynomial_models_give_colmaps_pixels_bit_for_bit(model: str) -> None:
    directions = np.random.default_rng(0).uniform(-0.7, 0.7, (10_000, 2))
    pixels = lens.photo_pixels(camera_of(model), directions)
    assert (pixels == colmap_pixels(camera_of(model), directions)).all()


def test_a_field_of_view_near_zero_and_directions_near_the_axis_match_colmap() -> None:
    for omega, extent in ((0.005, 0.7), (0.7, 1e-3)):
        camera = camera_of("FOV", (610.0, 590.0, 390.0, 310.0, omega))
        directions = np.random.default_rng(0).uniform(-extent, extent, (200, 2))
        expected = colmap_pixels(camera, directions)
        np.testing.assert_allclose(lens.photo_pixels(camera, directions), expected, atol=1e-6)


def test_directions_beyond_the_turning_point_have_no_pixel() -> None:
    camera = camera_of("SIMPLE_RADIAL", (610.0, 390.0, 310.0, -0.2))
    # 1 - 3 * 0.2 r^2 is 0 at r = 1.29: the model turns back there, and at r = 2.2 is almost at the centre again.
    pixels = lens.photo_pixels(camera, np.array([[1.2, 0.0], [2.2, 0.0]]))
    assert np.isfinite(pixels[0]).all() and np.isnan(pixels[1]).all()


def test_an_unknown_model_is_refused_with_a_sentence() -> None:
    with pytest.raises(errors.CameraError, match=r"lens model EQUIRECTANGULAR of a\.jpg is not known"):
        lens.photo_pixels(camera_of("EQUIRECTANGULAR", (800.0, 600.0, 0.0, 0.0)), np.zeros((1, 2)))


@pytest.mark.parametrize("model", sorted(PARAMETERS))
def test_a_lens_has_the_parameters_of_its_model(model: str) -> None:
    assert lens.lens_problem(camera_of(model).lens) is None
    assert "parameters" in str(lens.lens_problem(camera_of(model, (*PARAMETERS[model], 0.0)).lens))


def test_a_focal_length_of_zero_is_a_problem_of_either_axis() -> None:
    for params in ((0.0, 610.0, 390.0, 310.0), (610.0, 0.0, 390.0, 310.0), (610.0, np.nan, 390.0, 310.0)):
        assert lens.lens_problem(camera_of("PINHOLE", params).lens) is not None
