"""Cameras are read from their files bit for bit as written."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from engine.errors import FormatError
from engine.scene.camera import Camera, CameraSet
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


@pytest.mark.parametrize("damage", ["missing", "cut", "other version", "no points"])
def test_damaged_files_are_refused(tmp_path: Path, damage: str) -> None:
    write_camera_set(tmp_path, camera_set())
    file = tmp_path / "cameras.json"
    if damage == "missing":
        file.unlink()
    elif damage == "cut":
        file.write_text(file.read_text()[:-40])
    elif damage == "other version":
        file.write_text(file.read_text().replace('"version": 1', '"version": 7'))
    else:
        (tmp_path / "points.npz").write_bytes(b"PK")
    with pytest.raises(FormatError, match="reconstruct` |Use a new folder"):
        read_camera_set(tmp_path)
