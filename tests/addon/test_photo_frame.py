"""The background photo is upright and aligned with the splats."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageOps

from engine.cameras.undistortion import undistort
from engine.scene.camera import Camera, PinholeCamera

from .conftest import PACKAGE

photo_frame = importlib.import_module(f"{PACKAGE}.gaussian_heritage_addon.project.photo_frame")


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("with_thumbnail", [False, True])
def test_exif_orientation_is_applied(tmp_path: Path, orientation: int, with_thumbnail: bool) -> None:
    picture = np.random.default_rng(0).integers(0, 255, (24, 40, 3)).astype(np.uint8)
    image, exif = Image.fromarray(picture), Image.Exif()
    if with_thumbnail:
        exif[0x010F] = "A maker whose name comes first"
        exif[0x013B] = "somebody"
    exif[0x0112] = orientation
    file = tmp_path / "a.jpg"
    image.save(file, exif=exif, quality=100)
    assert photo_frame.exif_orientation(file) == orientation
    with Image.open(file) as stored:
        expected = np.asarray(ImageOps.exif_transpose(stored))
        np.testing.assert_array_equal(photo_frame.apply_orientation(np.asarray(stored), orientation), expected)


@pytest.mark.parametrize(
    "content",
    [
        b"", b"\x89PNG\r\n", b"\xff\xd8", b"\xff\xd8\xff\xe1\x00\x10Exif\0\0II*\0\xff\xff\xff\xff",
        b"\xff\xd8\xff\xe1\xff\xffExif\0\0MM", b"\xff\xd8\xff\xda\x00\x02",
    ],
)  # fmt: skip
def test_other_and_damaged_files_have_the_default_orientation(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.jpg").write_bytes(content)
    assert photo_frame.exif_orientation(tmp_path / "a.jpg") == 1
    assert photo_frame.exif_orientation(tmp_path / "missing.jpg") == 1


@pytest.mark.parametrize("size", [(600, 900), (301, 450)])
def test_distortion_is_removed_as_in_the_engine(size: tuple[int, int]) -> None:
    params = (640.0, 620.0, 470.0, 290.0, -0.2, 0.05, 0.003, -0.006)
    camera = Camera("a.jpg", 900, 600, "OPENCV", params, np.eye(4))
    y, x = np.mgrid[: size[0], : size[1]] / size[0]
    picture = np.stack([np.sin(9 * x + 4 * y), np.cos(7 * y), x * y, np.ones_like(x)], axis=-1).astype(np.float32)
    K = np.array([[640.0, 0, 470.0], [0, 620.0, 290.0], [0, 0, 1]])
    scale = np.diag([size[1] / 900, size[0] / 600, 1.0])
    expected = undistort(picture, camera, PinholeCamera(np.eye(4), scale @ K, size[1], size[0]))
    result = photo_frame.remove_distortion(picture, camera)
    assert result.shape == picture.shape and result.dtype == np.float32
    visible = (expected[..., 3] > 0.99) & (result[..., 3] > 0.99)
    assert visible.mean() > 0.9
    # The slope is 9 / 600 per pixel: an error of 0.05 pixels is 8e-4.
    assert np.abs(result - expected)[visible].max() < 2e-3
    assert ((expected[..., 3] > 0) != (result[..., 3] > 0)).mean() < 0.005
