"""COLMAP models and point clouds: whole ones are read exactly, damaged ones are refused soon and name the file."""

from __future__ import annotations

import math
import os
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from engine.cameras import model_reading
from engine.cameras.model_reading import cloud_in_child, model_in_child, read_cloud, read_model
from engine.cameras.reconstruction import viewmat_of
from engine.core.errors import CameraError, Cancelled, FormatError
from engine.core.events import never_stop

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="only Linux bounds the memory of a process")
N_IMAGES, N_POINTS = 4, 30
PLY = (
    "ply\nformat ascii 1.0\nelement vertex {}\n"
    + "".join(f"property float {axis}\n" for axis in "xyz")
    + "".join(f"property uchar {color}\n" for color in ("red", "green", "blue"))
    + "end_header\n"
)


def reconstruction() -> pycolmap.Reconstruction:
    """Return two lenses, four pictures and 30 points, which are seen in the first two pictures."""
    rng = np.random.default_rng(0)
    model = pycolmap.Reconstruction()
    for number, params in ((1, [380.0, 380.5, 200.0, 150.0]), (2, [1 / 3, 200.0, 150.0, -0.08])):
        name = "PINHOLE" if number == 1 else "SIMPLE_RADIAL"
        lens = pycolmap.Camera(model=name, width=400, height=300, params=params)
        lens.camera_id = number
        model.add_camera_with_trivial_rig(lens)
    pixels = rng.uniform(0, 300, (N_POINTS, 2))
    for number in range(1, N_IMAGES + 1):
        image = pycolmap.Image(name=f"{number}.jpg", camera_id=1 + number % 2, image_id=number, keypoints=pixels)
        quaternion = rng.normal(size=4)
        rotation = pycolmap.Rotation3d(quaternion / np.linalg.norm(quaternion))
        pose = pycolmap.Rigid3d(rotation, rng.normal(size=3) * 1e6)
        model.add_image_with_trivial_frame(image, pose)
    for row, position in enumerate(rng.normal(size=(N_POINTS, 3))):
        track = pycolmap.Track([pycolmap.TrackElement(1, row), pycolmap.TrackElement(2, row)])
        model.add_point3D(position, track, rng.integers(0, 256, 3).astype(np.uint8))
    return model


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    reconstruction().write_binary(tmp_path)
    return tmp_path


@pytest.mark.parametrize("text", [False, True], ids=["binary", "text"])
def test_numbers_are_exactly_those_that_colmap_reads(tmp_path: Path, text: bool) -> None:
    written = reconstruction()
    (written.write_text if text else written.write_binary)(tmp_path)
    expected = pycolmap.Reconstruction(tmp_path)
    images, points = read_model(tmp_path, never_stop)
    assert [image.name for image in images] == [expected.image(key).name for key in expected.reg_image_ids()]
    for image, key in zip(images, expected.reg_image_ids(), strict=True):
        lens = expected.camera(expected.image(key).camera_id)
        assert image.lens == (lens.model_name, lens.width, lens.height, tuple(lens.params))
        assert (image.viewmat == viewmat_of(expected.image(key))).all()
    keys = sorted(expected.points3D)
    assert (points.positions == [expected.points3D[key].xyz for key in keys]).all()
    assert (points.colors == [expected.points3D[key].color for key in keys]).all()
    error = expected.compute_mean_reprojection_error()
    assert points.reprojection_error == error or math.isnan(error)


def test_model_of_an_older_colmap_without_rigs_and_frames_is_read(folder: Path) -> None:
    (folder / "rigs.bin").unlink()
    (folder / "frames.bin").unlink()
    images, points = read_model(folder, never_stop)
    assert (len(images), len(points.positions)) == (N_IMAGES, N_POINTS)


def read_here(source: Path, function: Callable[[str, str, str], object]) -> None:
    """Call a function of the child in this process, which is faster."""
    function(str(source), str(source.with_name("arrays.npz")), f"The model {source}")


def cut_to(count: int) -> Callable[[bytes], bytes]:
    return lambda data: data[:count]


def overwritten(at: int, values: bytes) -> Callable[[bytes], bytes]:
    return lambda data: data[:at] + values + data[at + len(values) :]


# Where the first camera has its width and focal length, and the first image its camera. Of a frame, the quaternion is
# at 16 and the translation at 48.
_WIDTH, _FOCAL, _CAMERA_ID = 16, 32, 68


@pytest.mark.parametrize(
    ("name", "damage", "sentence"),
    [
        ("points3D.bin", cut_to(0), "points3D.bin ends too early"),
        ("points3D.bin", cut_to(500), "points3D.bin ends too early"),
        ("images.bin", cut_to(12), "images.bin ends too early"),
        ("images.bin", cut_to(40), "images.bin ends too early"),
        ("cameras.bin", cut_to(30), "cameras.bin ends too early"),
        ("cameras.bin", cut_to(-8), "cameras.bin ends too early"),
        ("rigs.bin", cut_to(20), "rigs.bin ends too early"),
        ("frames.bin", cut_to(-1), "frames.bin ends too early"),
        ("points3D.bin", overwritten(0, b"\xff" * 8), "points3D.bin ends too early"),
        ("points3D.bin", overwritten(51, b"\xff" * 8), "points3D.bin ends too early"),
        ("images.bin", overwritten(0, struct.pack("<Q", 1)), "images.bin has .* bytes more than its content needs"),
        ("cameras.bin", overwritten(_WIDTH, bytes(8)), "cannot have 0 x 300 pixels"),
        ("cameras.bin", overwritten(_WIDTH, b"\xff" * 7), "pixels"),
        ("cameras.bin", overwritten(_FOCAL, bytes(8)), "focal length that is not above 0"),
        ("cameras.bin", overwritten(_FOCAL, struct.pack("<d", -380.0)), "focal length that is not above 0"),
        ("cameras.bin", overwritten(_FOCAL, struct.pack("<d", math.inf)), "lens parameters that are not finite"),
        ("cameras.bin", overwritten(_FOCAL, struct.pack("<d", 1e300)), "lens parameters that are not finite"),
        ("cameras.bin", overwritten(12, b"\x63"), "cameras.bin"),
        ("images.bin", overwritten(_CAMERA_ID, b"\x09"), "incomplete or damaged"),
        ("frames.bin", overwritten(16, bytes(32)), "has no rotation"),
        ("frames.bin", overwritten(16, struct.pack("<d", math.nan)), "has no rotation"),
        ("frames.bin", overwritten(16, struct.pack("<4d", 1, 1, 1, 1)), "has no rotation"),
        ("frames.bin", overwritten(48, struct.pack("<d", math.nan)), "not finite or is too large"),
        ("frames.bin", overwritten(48, struct.pack("<d", 1e300)), "not finite or is too large"),
    ],
)
def test_damaged_model_is_refused(folder: Path, name: str, damage: Callable[[bytes], bytes], sentence: str) -> None:
    (folder / name).write_bytes(damage((folder / name).read_bytes()))
    with pytest.raises(CameraError, match=sentence) as caught:
        read_here(folder, model_in_child)
    assert str(folder) in str(caught.value)
    assert "Copy it again from where it was made, or let the cameras be estimated." in str(caught.value)


@pytest.mark.parametrize("name", ["cameras.txt", "images.txt"])
@pytest.mark.parametrize("change", [lambda text: text[: len(text) * 2 // 3], lambda text: text.replace(" ", " nan ")])
def test_damaged_text_model_is_refused(tmp_path: Path, name: str, change: Callable[[str], str]) -> None:
    reconstruction().write_text(tmp_path)
    (tmp_path / name).write_text(change((tmp_path / name).read_text()))
    with pytest.raises(CameraError, match="incomplete or damaged"):
        read_here(tmp_path, model_in_child)


def test_picture_name_that_is_not_utf8_is_refused(folder: Path) -> None:
    data = (folder / "images.bin").read_bytes()
    (folder / "images.bin").write_bytes(data.replace(b"1.jpg", b"\xff.jpg"))
    with pytest.raises(CameraError, match="incomplete or damaged"):
        read_here(folder, model_in_child)


def test_quaternion_of_few_digits_is_normalised(folder: Path) -> None:
    data = (folder / "frames.bin").read_bytes()
    (folder / "frames.bin").write_bytes(overwritten(16, struct.pack("<4d", 0.501, 0.5, 0.5, 0.5))(data))
    viewmat = read_model(folder, never_stop)[0][0].viewmat
    assert np.abs(viewmat[:3, :3] @ viewmat[:3, :3].T - np.eye(3)).max() < 1e-12


@pytest.fixture
def folder_of_many_points(folder: Path) -> Path:
    points = np.zeros(100_000, [("id", "<u8"), ("rest", "u1", 43)])
    points["id"] = np.arange(len(points))
    (folder / "points3D.bin").write_bytes(struct.pack("<Q", len(points)) + points.tobytes())
    return folder


@LINUX
def test_file_that_takes_all_memory_is_refused(tmp_path: Path) -> None:
    # COLMAP allocates what the header states before it looks for the points.
    (tmp_path / "cloud.ply").write_text(PLY.format(10**9).replace("ascii", "binary_little_endian"))
    with pytest.raises(CameraError, match="reading it takes more memory than files of this size need"):
        read_cloud(tmp_path / "cloud.ply", never_stop)


def test_model_that_takes_for_ever_is_refused(folder_of_many_points: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_reading, "_SMALLEST_SECONDS", 0.0)
    monkeypatch.setattr(model_reading, "_BYTES_PER_SECOND", 1e12)
    with pytest.raises(CameraError, match="reading it takes longer than files of this size need"):
        read_model(folder_of_many_points, never_stop)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no named pipes in folders")
def test_pipe_in_place_of_a_file_is_refused(folder: Path) -> None:
    (folder / "images.bin").unlink()
    os.mkfifo(folder / "images.bin")
    with pytest.raises(FormatError, match="images.bin cannot be read: it is not a file"):
        read_here(folder, model_in_child)


def test_reading_can_be_stopped(folder: Path) -> None:
    with pytest.raises(Cancelled):
        read_model(folder, lambda: True)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "cannot be read"),
        ("ply\n", "cannot be read"),
        (PLY.format(3) + "1 2 3 4 5 6\n", "it states 3 points and has 1"),
        (PLY.format(10**12) + "1 2 3 4 5 6\n", "cannot be read"),
        (PLY.format(-1) + "1 2 3 4 5 6\n", "cannot be read"),
        (PLY.format(1) + "1 2 3 4\n", "cannot be read"),
        (PLY.format(1) + "a b c 4 5 6\n", "cannot be read"),
    ],
)
def test_damaged_point_cloud_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "cloud.ply").write_text(text)
    with pytest.raises(CameraError, match=sentence) as caught:
        read_here(tmp_path / "cloud.ply", cloud_in_child)
    assert "cloud.ply" in str(caught.value)


def test_binary_point_cloud_that_is_cut_is_refused(tmp_path: Path) -> None:
    header = PLY.format(50).replace("ascii", "binary_little_endian").encode()
    file = tmp_path / "cloud.ply"
    file.write_bytes(header + 50 * struct.pack("<3f3B", 1, 2, 3, 4, 5, 6))
    assert len(read_cloud(file, never_stop).positions) == 50
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(CameraError, match="cloud.ply"):
        read_here(file, cloud_in_child)
