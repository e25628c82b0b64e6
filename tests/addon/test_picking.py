"""A click in the window is mapped to the pixel of the photo that is shown there."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

from engine.cameras.undistortion import project
from engine.scene.camera import Camera

from .conftest import PACKAGE

picking = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.project.picking")
errors = importlib.import_module(f"{PACKAGE}.engine.core.errors")


def pose() -> np.ndarray:
    """Return the world-to-camera matrix of a camera at (0.3, -3, 1) that looks at the origin."""
    eye = np.array([0.3, -3.0, 1.0])
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0.1, 0, 1])
    right /= np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = [right, np.cross(forward, right), forward]
    viewmat[:3, 3] = -viewmat[:3, :3] @ eye
    return viewmat


CAMERA = Camera("a/b.jpg", 900, 600, "OPENCV", (640.0, 620.0, 470.0, 290.0, -0.2, 0.05, 0.003, -0.006), pose())


def view_of(camera: Camera, *, zoom: float, shift: tuple[float, float]) -> object:
    """A region of 1000 x 700 as Blender's camera view: zoomed and shifted, off-centre, Y up, depth between 0.001 and
    1000, in float32 as in Blender."""
    near, far = 0.001, 1000.0
    depth = [0.0, 0.0, -(far + near) / (far - near), -2 * far * near / (far - near)]
    lens = np.array([[1.3 * zoom, 0, shift[0], 0], [0, 1.8 * zoom, shift[1], 0], depth, [0, 0, -1, 0]])
    world_from_camera = np.linalg.inv(camera.viewmat) @ picking.FLIP
    window = (lens @ np.linalg.inv(world_from_camera)).astype(np.float32).astype(np.float64)
    return picking.View(1000, 700, window, world_from_camera.astype(np.float32).astype(np.float64))


@pytest.mark.parametrize(("zoom", "shift"), [(1.0, (0.0, 0.0)), (0.4, (0.2, -0.3)), (3.0, (-0.5, 0.4))])
def test_click_on_a_point_is_its_pixel_in_the_photo(zoom: float, shift: tuple[float, float]) -> None:
    view = view_of(CAMERA, zoom=zoom, shift=shift)
    points = np.random.default_rng(1).uniform(-0.9, 0.9, (50, 3))
    expected, _ = project(CAMERA, points)
    for point, pixel in zip(points, expected, strict=True):
        x, y, _, w = view.window_from_world @ [*point, 1.0]
        position = ((x / w + 1) * 500, (y / w + 1) * 350)
        direction = view.direction(*position)
        # Blender's matrices are float32 (worst error seen: 2e-4 pixels); pixels are rounded to a hundredth.
        np.testing.assert_allclose(picking.photo_pixel(CAMERA, direction), pixel, atol=0.01)
        # The mark is drawn where the click was made.
        np.testing.assert_allclose(view.region_position(direction), position, atol=0.01)


def test_distortion_and_the_photos_corner_matter_here() -> None:
    """The test above could not detect missing distortion if it were small."""
    pinhole = Camera("a/b.jpg", 900, 600, "PINHOLE", CAMERA.params[:4], CAMERA.viewmat)
    points = np.random.default_rng(1).uniform(-0.9, 0.9, (50, 3))
    assert np.abs(project(CAMERA, points)[0] - project(pinhole, points)[0]).max() > 3.0


def test_click_beside_the_photo_is_a_clear_error() -> None:
    with pytest.raises(errors.CameraError, match=r"outside the photo a/b\.jpg"):
        picking.photo_pixel(CAMERA, (-2.0, 0.0))


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_scene_and_cameras_may_be_moved_together(scale: float) -> None:
    moved = np.diag([scale, scale, scale, 1.0])
    moved[:3, 3] = (3.0, -1.0, 2.0)
    world_from_camera = moved @ np.linalg.inv(CAMERA.viewmat) @ picking.FLIP
    picking.require_aligned(CAMERA, world_from_camera, moved)
    with pytest.raises(errors.CameraError, match="no longer lines up"):
        picking.require_aligned(CAMERA, world_from_camera, np.eye(4))


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
@pytest.mark.parametrize("which", ["camera", "scene"])
def test_flattened_or_lost_pose_is_refused(which: str, value: float) -> None:
    matrices = {"camera": np.linalg.inv(CAMERA.viewmat) @ picking.FLIP, "scene": np.eye(4)}
    matrices[which][:3] = value
    with pytest.raises(errors.CameraError):
        picking.require_aligned(CAMERA, matrices["camera"], matrices["scene"])


@pytest.mark.parametrize("which", ["camera", "scene"])
def test_one_moved_without_the_other_is_refused(which: str) -> None:
    world_from_camera, scene = np.linalg.inv(CAMERA.viewmat) @ picking.FLIP, np.eye(4)
    moved = world_from_camera if which == "camera" else scene
    moved[0, 3] += 0.05
    with pytest.raises(errors.CameraError, match="no longer lines up with the scene"):
        picking.require_aligned(CAMERA, world_from_camera, scene)
