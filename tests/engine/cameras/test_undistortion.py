"""A photo is undistorted to an ideal picture, and distorted back to the same pixels."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from engine.cameras.undistortion import (
    covering_pinhole,
    distort,
    is_point_visible,
    project,
    read_camera_json,
    training_pinhole,
    undistort,
)
from engine.core.errors import CameraError, FormatError
from engine.scene.camera import Camera, PinholeCamera

from .conftest import looking_at

W, H = 500, 400
LENSES: dict[str, tuple[str, tuple[float, ...]]] = {
    "none": ("SIMPLE_PINHOLE", (450.0, 250.0, 200.0)),
    "not square": ("PINHOLE", (450.0, 430.0, 245.0, 203.0)),
    "barrel": ("SIMPLE_RADIAL", (600.0, 250.0, 200.0, -0.3)),
    "strong barrel": ("SIMPLE_RADIAL", (480.0, 250.0, 200.0, -0.3)),
    "pincushion": ("SIMPLE_RADIAL", (450.0, 250.0, 200.0, 0.2)),
    "tangential": ("OPENCV", (450.0, 440.0, 255.0, 195.0, -0.2, 0.05, 0.003, -0.002)),
    "eight": ("FULL_OPENCV", (450.0, 450.0, 250.0, 200.0, 0.1, 0.01, 0.001, 0.001, 0.01, 0.02, 0.001, 0.0)),
    "fisheye": ("OPENCV_FISHEYE", (300.0, 300.0, 250.0, 200.0, 0.01, 0.0, 0.0, 0.0)),
}
ASYMMETRIC = looking_at(np.array([3.0, -2.0, 1.5]), np.array([0.2, 0.4, 0.1]), roll=0.3)


def camera(lens: str) -> Camera:
    model, params = LENSES[lens]
    return Camera("a.jpg", W, H, model, params, ASYMMETRIC)


def pixel_positions(width: int = W, height: int = H) -> NDArray[np.float32]:
    """Return a picture whose pixels contain the positions of their centres."""
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.stack([x, y], axis=-1).astype(np.float32)


def project_pinhole(pinhole: PinholeCamera, points: NDArray[np.float64]) -> NDArray[np.float64]:
    local = points @ pinhole.viewmat[:3, :3].T + pinhole.viewmat[:3, 3]
    return (local[:, :2] / local[:, 2:]) * np.diag(pinhole.K)[:2] + pinhole.K[:2, 2]


@pytest.mark.parametrize("lens", LENSES)
def test_distortion_is_the_inverse_of_undistortion(lens: str) -> None:
    photo = camera(lens)
    frame = covering_pinhole(photo)
    positions = pixel_positions()
    back = distort(undistort(positions, photo, frame), frame, photo)
    assert back.shape == positions.shape
    inner = np.s_[6:-6, 6:-6]
    # Bilinear sampling twice in 1/32 pixel steps; worst seen 0.011.
    assert np.abs(back - positions)[inner].max() < 0.05


@pytest.mark.parametrize("lens", LENSES)
def test_a_point_is_seen_at_the_same_place_in_the_photo_and_in_the_undistorted_picture(lens: str) -> None:
    photo = camera(lens)
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.6, 0.6, (200, 3))
    pixels, depth = project(photo, points)
    inside = ((pixels > 2) & (pixels < (W - 2, H - 2))).all(axis=1)
    assert inside.sum() > 50
    assert np.allclose(depth, points @ ASYMMETRIC[2, :3] + ASYMMETRIC[2, 3])
    frame = covering_pinhole(photo)
    where = undistort(pixel_positions(), photo, frame)
    ideal = project_pinhole(frame, points)
    # The undistorted picture contains at each place the position of the photo's pixel.
    shown = np.stack(
        [
            cv2.remap(
                np.ascontiguousarray(where[..., axis]),
                (ideal[:, 0] - 0.5).astype(np.float32)[:, None],
                (ideal[:, 1] - 0.5).astype(np.float32)[:, None],
                cv2.INTER_LINEAR,
            )[:, 0]
            for axis in (0, 1)
        ],
        axis=1,
    )
    assert np.abs(shown - pixels)[inside].max() < 0.05


def test_without_distortion_the_training_frame_is_the_photo() -> None:
    frame = training_pinhole(camera("none"), max_side=10_000)
    assert (frame.width, frame.height) == (W, H)
    assert np.allclose(frame.K, [[450.0, 0, 250.0], [0, 450.0, 200.0], [0, 0, 1]])
    image = np.random.default_rng(0).integers(0, 256, (H, W, 3), dtype=np.uint8)
    assert (undistort(image, camera("none"), frame) == image).all()
    assert (distort(image, frame, camera("none")) == image).all()


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("max_side", [10_000, 333])
def test_the_training_frame_has_no_blank_border_and_touches_the_photos_border(lens: str, max_side: int) -> None:
    photo = camera(lens)
    frame = training_pinhole(photo, max_side=max_side)
    assert max(frame.width, frame.height) <= max_side
    assert (undistort(np.full((H, W), 255, np.uint8), photo, frame) == 255).all()
    assert (frame.viewmat == ASYMMETRIC).all()
    # Its corners lie in the photo.
    ends = np.array([[0, 0, 1], [frame.width, frame.height, 1]]) @ np.linalg.inv(frame.K).T
    corners = np.array([[x, y, 1.0] for x in ends[:, 0] for y in ends[:, 1]])
    world = (corners - ASYMMETRIC[:3, 3]) @ ASYMMETRIC[:3, :3]
    pixels, _ = project(photo, world)
    assert (pixels > -0.01).all()
    assert (pixels < (W + 0.01, H + 0.01)).all()


@pytest.mark.parametrize("lens", [name for name in LENSES if name != "strong barrel"])
def test_the_covering_frame_shows_every_pixel_of_the_photo(lens: str) -> None:
    photo = camera(lens)
    frame = covering_pinhole(photo)
    covered = distort(np.full((frame.height, frame.width), 255, np.uint8), frame, photo)
    assert (covered == 255).all()


def test_labels_and_booleans_are_not_interpolated() -> None:
    photo = camera("barrel")
    frame = training_pinhole(photo, max_side=200)
    labels = np.random.default_rng(0).integers(0, 2**31 - 1, (H // 2, W // 2), dtype=np.int32)
    small = undistort(labels, photo, frame, interpolation="nearest")
    assert small.dtype == np.int32
    assert small.shape == (frame.height, frame.width)
    assert np.isin(small, labels).all()
    mask = np.zeros((frame.height, frame.width), bool)
    mask[:, : frame.width // 2] = True
    back = distort(mask, frame, photo, interpolation="nearest")
    assert back.dtype == bool
    assert back.shape == (H, W)
    assert 0.3 < back.mean() < 0.6


@pytest.mark.parametrize("dtype", [np.uint8, np.float32, np.float64])
@pytest.mark.parametrize("channels", [(), (1,), (3,), (17,)])
def test_any_number_of_channels_keeps_its_shape_and_type(dtype: type, channels: tuple[int, ...]) -> None:
    photo = camera("barrel")
    frame = training_pinhole(photo, max_side=100)
    image = np.ones((H, W, *channels), dtype)
    out = undistort(image, photo, frame)
    assert out.shape == (frame.height, frame.width, *channels)
    assert out.dtype == dtype


def test_a_resized_photo_has_the_same_frame() -> None:
    photo = camera("tangential")
    frame = training_pinhole(photo, max_side=250)
    smooth = pixel_positions()
    half = cv2.resize(smooth, (W // 2, H // 2), interpolation=cv2.INTER_AREA)
    assert np.abs(undistort(smooth, photo, frame) - undistort(half, photo, frame)).max() < 0.3


def test_shrinking_does_not_alias() -> None:
    photo = camera("none")
    stripes = np.tile(np.array([[0, 255]], np.uint8), (H, W // 2))
    small = undistort(stripes, photo, training_pinhole(photo, max_side=125))
    assert small.std() < 5
    assert abs(small.mean() - 127.5) < 2


def test_points_behind_the_camera_or_beyond_the_turning_point_have_no_pixel() -> None:
    photo = Camera("a.jpg", W, H, "SIMPLE_RADIAL", (480.0, 250.0, 200.0, -0.3), np.eye(4))
    points = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.1, 0.1, 0.0], [1.5, 0.0, 1.0], [0.9, 0.0, 1.0]])
    pixels, depth = project(photo, points)
    assert np.isnan(pixels).any(axis=1).tolist() == [False, True, True, True, False]
    assert depth.tolist() == [1.0, -1.0, 0.0, 1.0, 1.0]
    assert project(photo, np.zeros((0, 3)))[0].shape == (0, 2)


def test_points_in_front_of_a_camera_and_within_its_picture_are_visible() -> None:
    photo = Camera("a.jpg", W, H, *LENSES["none"], np.eye(4))
    places = ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.5, 0.0, 1.0], [0.6, 0.0, 1.0])
    assert [is_point_visible(photo, np.array(place)) for place in places] == [True, False, True, False]


@pytest.mark.parametrize(
    ("model", "params"),
    [
        ("SIMPLE_RADIAL", (400.0, 250.0, 200.0)),
        ("NO_SUCH_MODEL", (400.0,)),
        ("SIMPLE_PINHOLE", (float("nan"), 250.0, 200.0)),
        ("SIMPLE_PINHOLE", (-400.0, 250.0, 200.0)),
        ("EQUIRECTANGULAR", (500.0, 400.0)),
    ],
)
def test_an_invalid_lens_is_refused(model: str, params: tuple[float, ...]) -> None:
    with pytest.raises(CameraError):
        training_pinhole(Camera("a.jpg", W, H, model, params, np.eye(4)), max_side=100)


GOOD = {"width": 64, "height": 48, "fx": 50.0, "fy": 51.0, "cx": 32.0, "cy": 24.0, "viewmat": ASYMMETRIC.tolist()}


def test_a_camera_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "c.json").write_text(json.dumps(GOOD))
    pinhole = read_camera_json(tmp_path / "c.json")
    assert (pinhole.width, pinhole.height) == (64, 48)
    assert pinhole.K.tolist() == [[50.0, 0.0, 32.0], [0.0, 51.0, 24.0], [0.0, 0.0, 1.0]]
    assert (pinhole.viewmat == ASYMMETRIC).all()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"fx": 0}, "must be positive"),
        ({"width": -1}, "must be positive"),
        ({"fx": "wide"}, "`fx` must be a finite number"),
        ({"cx": float("nan")}, "NaN is not a JSON number"),
        ({"viewmat": [[1e400] * 4] * 4}, "Infinity is not a JSON number"),
        ({"viewmat": [[1, 0], [0, 1]]}, "4 rows of 4"),
        ({"viewmat": (2 * np.eye(4)).tolist()}, "scaled, skewed or mirrored"),
        ({"viewmat": np.diag([1.0, 1.0, -1.0, 1.0]).tolist()}, "scaled, skewed or mirrored"),
        ({"viewmat": ASYMMETRIC.T.tolist()}, "last row"),
        ({"viewmat": None}, "`viewmat` must be a list"),
        ({"viewmat": [[1, 0, 0, 0], [1], [], [0, 0, 0, 1]]}, "4 rows of 4"),
    ],
)
def test_an_invalid_camera_file_is_refused_with_the_reason(
    tmp_path: Path, change: dict[str, object], sentence: str
) -> None:
    (tmp_path / "c.json").write_text(json.dumps({**GOOD, **change}))
    with pytest.raises((CameraError, FormatError), match=sentence):
        read_camera_json(tmp_path / "c.json")


@pytest.mark.parametrize("text", ["", "[]", "{}", "nonsense"])
def test_a_file_that_is_not_a_camera_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "c.json").write_text(text)
    with pytest.raises(FormatError, match=r"c\.json"):
        read_camera_json(tmp_path / "c.json")
    with pytest.raises(FormatError, match="cannot be read"):
        read_camera_json(tmp_path / "missing.json")
