"""Counts of the training photos that see what a picture shows, and the quality that is told with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from engine.core.events import never_stop
from engine.scene import Camera, CameraSet, Gaussians, PinholeCamera
from engine.training.coverage import Coverage
from engine.training.parameters import Parameters
from engine.training.quality import MeasuredQuality, measure_quality

WIDTH, HEIGHT, FOCAL = 80, 60, 80.0


def camera_at(x: float) -> PinholeCamera:
    """A camera at (x, 0, 0) that looks along z."""
    viewmat = np.eye(4)
    viewmat[0, 3] = -x
    return PinholeCamera(viewmat, np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]]), WIDTH, HEIGHT)


def wall(x_range: tuple[float, float], depth: float, half_height: float = 4.0, grey: float = 0.5) -> Gaussians:
    """A wall of opaque Gaussians at one depth."""
    x, y = np.meshgrid(np.arange(*x_range, 0.1), np.arange(-half_height, half_height, 0.1))
    means = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, depth)]).astype(np.float32)
    n = len(means)
    return Gaussians(
        means=means,
        log_scales=np.full((n, 3), np.log(0.07), np.float32),
        quats=np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
        opacity_logits=np.full(n, 4.0, np.float32),
        sh=np.full((n, 1, 3), (grey - 0.5) / 0.28209479, np.float32),
        features=None,
    )


def values_of(gaussians: Gaussians) -> dict[str, torch.Tensor]:
    return Parameters.from_gaussians(gaussians, sh_degree=0, features=False).values


def test_places_at_the_side_are_seen_by_fewer_photos() -> None:
    # Each camera sees x from -2 to 2 beside itself at depth 4.
    coverage = Coverage(values_of(wall((-8, 8), 4.0)), [camera_at(x) for x in (-2.0, 0.0, 2.0)])
    counts = coverage.counts(camera_at(0.0))
    # The pixel in column c shows x = (c - 39.5) / 20: the left camera sees x < 0, the right one x > 0.
    assert set(counts[30, 2:38]) == {2} and set(counts[30, 42:78]) == {2}
    beside = coverage.counts(camera_at(4.0))[30]
    assert set(beside[2:36]) == {1} and set(beside[44:78]) == {0}


def test_what_stands_before_a_place_hides_it() -> None:
    # A board before the middle camera, at half of the depth.
    scene = wall((-8, 8), 4.0).joined(wall((-0.3, 0.3), 2.0))
    counts = Coverage(values_of(scene), [camera_at(0.0)]).counts(camera_at(2.0))
    # The camera at 2 sees the wall at x = 0 in column 0, and there the board hides it from the camera at 0.
    assert counts[30, 2] == 0, "hidden by the board"
    assert counts[30, 30] == 1, "x = 1.5, beside the board"


def test_pixels_without_a_surface_are_seen_by_no_photo() -> None:
    coverage = Coverage(values_of(wall((-8, 0), 4.0)), [camera_at(0.0)] * 3)
    counts = coverage.counts(camera_at(0.0))
    assert set(counts[30, :36]) == {3} and set(counts[30, 44:]) == {0}


@pytest.fixture
def photo_set(tmp_path: Path) -> tuple[Path, CameraSet]:
    """Five photos of a grey wall, neighbours of each other."""
    cameras = []
    for index in range(5):
        name = f"{index}.png"
        Image.new("RGB", (WIDTH, HEIGHT), (128, 128, 128)).save(tmp_path / name)
        params = (FOCAL, WIDTH / 2, HEIGHT / 2)
        cameras.append(Camera(name, WIDTH, HEIGHT, "SIMPLE_PINHOLE", params, camera_at(0.1 * index).viewmat))
    points, colors = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8)
    return tmp_path, CameraSet(tuple(cameras), (), points, colors, float("nan"), np.eye(4), poses_given=True)


def test_quality_says_what_few_photos_saw_and_what_is_dark(photo_set: tuple[Path, CameraSet]) -> None:
    folder, cameras = photo_set

    def measured(gaussians: Gaussians, trained: list[str]) -> MeasuredQuality:
        return measure_quality(
            gaussians, folder, cameras, ["2.png"], trained=trained, max_side=WIDTH, should_stop=never_stop
        )

    training = ["0.png", "1.png", "3.png", "4.png"]
    right = measured(wall((-8, 8), 4.0), training)
    assert right.dark_share == 0 and right.well_seen_share > 0.9 and right.quality.psnr > 30
    dim = measured(wall((-8, 8), 4.0, grey=0.4), training)
    assert dim.fitted.psnr > dim.quality.psnr + 5 and dim.dark_share == 0, "a photo's exposure is not an error of shape"
    # Half of the wall is missing: it is black there, and nothing of that is well seen.
    half = measured(wall((-8, 0.2), 4.0), training)
    assert half.dark_share == pytest.approx(0.5, abs=0.05) == half.well_seen_share
    assert half.well_seen is not None and half.well_seen.psnr > 30 > half.quality.psnr
    assert measured(wall((-8, 8), 4.0), training[:2]).well_seen is None
