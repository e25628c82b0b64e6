"""Cameras are read from their files bit for bit as written."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import FormatError
from engine.scene.camera import Camera, CameraSet
from engine.scene.camera_health import CameraHealth
from engine.scene.camera_storage import read_camera_set, write_camera_set

from ..cameras.conftest import looking_at


def camera_set(points: int = 7) -> CameraSet:
    rng = np.random.default_rng(0)
    viewmat = looking_at(np.array([3.0, 1.0, 2.0]), np.zeros(3), 0.1)
    return CameraSet(
        cameras=(Camera("a b/ü.jpg", 4000, 3000, "SIMPLE_RADIAL", (3210.1, 2000.0, 1500.0, -1 / 3), viewmat),),
        unregistered=("z.png",),
        points=rng.standard_normal((points, 3)).astype(np.float32),
        point_colors=rng.integers(0, 256, (points, 3), dtype=np.uint8),
        reprojection_error=0.1 + 0.2,
        original_from_world=np.diag([3.0, 3.0, 3.0, 1.0]) + np.eye(4, k=3) * (4.5e6 + 1 / 3),
        poses_given=True,
    )


@pytest.mark.parametrize("points", [0, 7])
@pytest.mark.parametrize("error", [0.30000000000000004, math.nan])
def test_a_camera_set_is_read_as_written(tmp_path: Path, points: int, error: float) -> None:
    written = dataclasses.replace(camera_set(points), reprojection_error=error)
    write_camera_set(tmp_path / "cameras", written)
    read = read_camera_set(tmp_path / "cameras")
    for field in dataclasses.fields(CameraSet):
        a, b = getattr(written, field.name), getattr(read, field.name)
        if field.name == "cameras":
            for x, y in zip(a, b, strict=True):
                assert (x.viewmat == y.viewmat).all()
                assert dataclasses.replace(x, viewmat=None) == dataclasses.replace(y, viewmat=None)
        elif isinstance(a, np.ndarray):
            assert a.dtype == b.dtype
            assert a.shape == b.shape
            assert (a == b).all()
        else:
            assert a == b or (math.isnan(a) and math.isnan(b))
    assert not list(tmp_path.rglob(".writing-*"))


def test_the_health_of_the_cameras_survives(tmp_path: Path) -> None:
    health = CameraHealth("red", "given_cameras", "The given cameras of z.png do not fit.", ("z.png",))
    write_camera_set(tmp_path, dataclasses.replace(camera_set(), health=health))
    assert read_camera_set(tmp_path).health == health


def test_a_health_of_no_colour_is_refused(tmp_path: Path) -> None:
    write_camera_set(tmp_path, dataclasses.replace(camera_set(), health=CameraHealth("red", "unclear", "Bad.")))
    file = tmp_path / "cameras.json"
    file.write_text(file.read_text(encoding="utf-8").replace('"red"', '"blue"'), encoding="utf-8")
    with pytest.raises(FormatError, match="`health.colour` is 'blue'"):
        read_camera_set(tmp_path)


@pytest.mark.parametrize("damage", ["missing", "cut", "other version", "no points"])
def test_damaged_files_are_refused(tmp_path: Path, damage: str) -> None:
    write_camera_set(tmp_path, camera_set())
    file = tmp_path / "cameras.json"
    if damage == "missing":
        file.unlink()
    elif damage == "cut":
        file.write_text(file.read_text(encoding="utf-8")[:-40])
    elif damage == "other version":
        file.write_text(file.read_text(encoding="utf-8").replace('"version": 1', '"version": 7'))
    else:
        (tmp_path / "points.npz").write_bytes(b"PK")
    with pytest.raises(FormatError, match="reconstruct` |Update Gaussian Heritage"):
        read_camera_set(tmp_path)


def set_in(folder: Path, place: str, value: object) -> None:
    """Change one value of cameras.json, which other programs may write with any number."""
    file = folder / "cameras.json"
    data = json.loads(file.read_text(encoding="utf-8"))
    *parents, last = place.split("/")
    target = data
    for name in parents:
        target = target[int(name) if isinstance(target, list) else name]
    target[int(last) if isinstance(target, list) else last] = value
    file.write_text(json.dumps(data), encoding="utf-8")


TURNED = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]


def changed(row: int, column: int, value: float) -> list[list[float]]:
    matrix = [list(line) for line in TURNED]
    matrix[row][column] = value
    return matrix


@pytest.mark.parametrize(
    ("place", "value", "problem"),
    [
        ("cameras/0/width", 0, "it cannot have 0 x 3000 pixels"),
        ("cameras/0/height", -5, "it cannot have 4000 x -5 pixels"),
        ("cameras/0/width", 10**6, "it cannot have 1000000 x 3000 pixels"),
        ("cameras/0/width", 4000.5, "must be a whole number"),
        ("cameras/0/width", 10**30, "must be a whole number"),
        ("cameras/0/model", "PINHOLES", "lens model 'PINHOLES' is not known"),
        ("cameras/0/model", "OPENCV", "lens model OPENCV has 8 parameters, not 4"),
        ("cameras/0/model", "x" * 100_000, "is not known"),
        ("cameras/0/params", [], "has 4 parameters, not 0"),
        ("cameras/0/params/0", 0, "focal length must be above 0"),
        ("cameras/0/params/0", -3000.0, "focal length must be above 0"),
        ("cameras/0/params/0", 1e-300, "focal length must be above 0"),
        ("cameras/0/params/1", 1e300, "not finite or is too large"),
        ("cameras/0/params/1", None, "must be a finite number"),
        ("cameras/0/viewmat", [], "4 rows of 4 numbers"),
        ("cameras/0/viewmat/1", [1.0], "4 rows of 4 numbers"),
        ("cameras/0/viewmat", changed(0, 0, 2.0), "not a rotation and a translation"),
        ("cameras/0/viewmat", changed(0, 0, -1.0), "not a rotation and a translation"),
        ("cameras/0/viewmat", changed(3, 3, 2.0), "not a rotation and a translation"),
        ("cameras/0/viewmat", changed(0, 1, 0.001), "not a rotation and a translation"),
        ("cameras/0/viewmat", changed(0, 3, 1e200), "too large"),
        ("cameras/0/photo", "../x.jpg", "is not the name of a photo"),
        ("cameras/0/photo", 7, "must be a text"),
        ("unregistered/0", "/x.jpg", "is not the name of a photo"),
        ("original_from_world", changed(0, 0, 0.0), "`original_from_world` is not a rotation"),
        ("original_from_world", [[0.0] * 4] * 4, "`original_from_world` is not a rotation"),
        ("poses_given", "yes", "must be true or false"),
        ("reprojection_error", [], "must be a finite number or null"),
        ("cameras", {}, "must be a list"),
    ],
)
def test_a_camera_that_cannot_exist_is_refused(tmp_path: Path, place: str, value: object, problem: str) -> None:
    """Used as they are, such values end in a division by zero or a missing index later."""
    write_camera_set(tmp_path, camera_set())
    set_in(tmp_path, place, value)
    with pytest.raises(FormatError) as caught:
        read_camera_set(tmp_path)
    message = str(caught.value)
    assert problem in message and "cameras.json cannot be read" in message and "run `reconstruct` again" in message
    assert len(message) < 1000


def test_a_pose_rounded_to_float32_is_read(tmp_path: Path) -> None:
    written = camera_set()
    write_camera_set(tmp_path, written)
    set_in(tmp_path, "cameras/0/viewmat", np.float32(written.cameras[0].viewmat).tolist())
    assert len(read_camera_set(tmp_path).cameras) == 1


def test_two_cameras_of_one_photo_are_refused(tmp_path: Path) -> None:
    written = camera_set()
    write_camera_set(tmp_path, dataclasses.replace(written, cameras=written.cameras * 2))
    with pytest.raises(FormatError, match="has two cameras"):
        read_camera_set(tmp_path)


@pytest.mark.parametrize(
    "arrays",
    [
        {"points": np.zeros((3, 3), np.float32)},
        {"points": np.zeros((3, 3), np.float32), "colors": np.zeros((4, 3), np.uint8)},
        {"points": np.full((3, 3), np.nan, np.float32), "colors": np.zeros((3, 3), np.uint8)},
        {"points": np.zeros((3, 2), np.float32), "colors": np.zeros((3, 3), np.uint8)},
        {"points": np.array(["a"]), "colors": np.zeros((3, 3), np.uint8)},
    ],
)
def test_points_of_another_shape_are_refused(tmp_path: Path, arrays: dict[str, np.ndarray]) -> None:
    write_camera_set(tmp_path, camera_set())
    np.savez(tmp_path / "points.npz", **arrays)
    with pytest.raises(FormatError, match=r"points\.npz cannot be read: .* run `reconstruct` again"):
        read_camera_set(tmp_path)


@pytest.mark.parametrize("part", [0.0, 0.1, 0.5, 0.9])
def test_half_a_file_of_points_is_one_sentence(tmp_path: Path, part: float) -> None:
    write_camera_set(tmp_path, camera_set())
    data = (tmp_path / "points.npz").read_bytes()
    (tmp_path / "points.npz").write_bytes(data[: int(part * len(data))])
    with pytest.raises(FormatError, match=r"points\.npz cannot be read"):
        read_camera_set(tmp_path)
