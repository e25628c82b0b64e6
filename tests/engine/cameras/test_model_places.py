"""The model of a project is found where programs put it, and of several sub-models the photos get as much as
possible."""

from __future__ import annotations

import re
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.cameras.given import has_points, read_cameras
from engine.cameras.model_places import find_models
from engine.cameras.undistortion import project
from engine.core.errors import CameraError
from engine.core.events import Warned
from engine.scene import Photo, PhotoSet

from .conftest import HEIGHT, WIDTH, Scene
from .test_given import ORIGIN, POINTS, assert_true, write_colmap

pytestmark = pytest.mark.usefixtures("readers_in_this_process")


def part(room: Scene, first: int, last: int) -> Scene:
    return Scene(room.photo_set, room.cameras[first:last])


def moved(room: Scene, first: int, last: int) -> Scene:
    """Return cameras in a world that is turned, scaled and shifted."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    cameras = []
    for camera in room.cameras[first:last]:
        viewmat = np.eye(4)
        viewmat[:3, :3] = camera.viewmat[:3, :3] @ turn.T
        viewmat[:3, 3] = -viewmat[:3, :3] @ (2.5 * turn @ camera.center + (3.0, -1.0, 0.5))
        cameras.append(replace(camera, viewmat=viewmat))
    return Scene(room.photo_set, tuple(cameras))


PLACES = (
    "", "0", "sparse", "sparse/0", "sparse/3", "colmap/sparse/0", "colmap/sparse", "distorted/sparse/0", "dense/sparse",
    "dense/0/sparse",
)  # fmt: skip


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("suffix", [".bin", ".txt"])
def test_the_model_is_found_in_its_usual_places(tmp_path: Path, place: str, suffix: str) -> None:
    (tmp_path / place).mkdir(parents=True, exist_ok=True)
    (tmp_path / place / f"cameras{suffix}").touch()
    (found,) = find_models(tmp_path)
    assert found.parts == (tmp_path / place,)
    assert has_points(tmp_path)


def test_names_with_blanks_are_read_whole_from_a_text_model(room: Scene, tmp_path: Path) -> None:
    photos = tuple(replace(photo, name=f"my photo {photo.name}") for photo in room.photo_set.photos)
    model = write_colmap(room, tmp_path / "model", ORIGIN, text=True, prefix="all scans/my photo ")
    found = read_cameras(model, PhotoSet(room.photo_set.folder, photos, ()))
    assert [camera.photo for camera in found.cameras] == [photo.name for photo in photos]


def test_the_largest_of_unconnected_sub_models_is_used_and_the_others_are_told(room: Scene, tmp_path: Path) -> None:
    write_colmap(part(room, 0, 3), tmp_path / "sparse" / "0", ORIGIN)
    write_colmap(part(room, 3, 8), tmp_path / "sparse" / "1", ORIGIN)
    events: list[object] = []
    found = read_cameras(tmp_path, room.photo_set, emit=events.append)
    assert [camera.photo for camera in found.cameras] == [camera.photo for camera in room.cameras[3:]]
    assert found.unregistered == ("00.png", "01.png", "02.png")
    (warning,) = (event for event in events if isinstance(event, Warned))
    assert warning.message == (
        f"The model in {tmp_path} has 2 parts: the largest, sparse/1 with 5 photos, is used; not used, because nothing "
        "connects them: sparse/0 with 3 more photos (00.png, 01.png, 02.png)."
    )


def test_a_sub_model_that_is_chosen_itself_is_used_though_another_is_larger(room: Scene, tmp_path: Path) -> None:
    write_colmap(part(room, 0, 3), tmp_path / "sparse" / "0", ORIGIN)
    write_colmap(part(room, 3, 8), tmp_path / "sparse" / "1", ORIGIN)
    assert len(read_cameras(tmp_path / "sparse" / "0", room.photo_set).cameras) == 3


def test_sub_models_with_common_photos_are_joined(room: Scene, tmp_path: Path) -> None:
    """The second has a world of its own: turned, 2.5 times as large and shifted."""
    write_colmap(part(room, 0, 5), tmp_path / "sparse" / "0", ORIGIN)
    write_colmap(moved(room, 3, 8), tmp_path / "sparse" / "1", ORIGIN)
    events: list[object] = []
    found = read_cameras(tmp_path, room.photo_set, emit=events.append)
    assert_true(found, room, ORIGIN)
    assert len(found.points) == 2 * len(POINTS)
    (warning,) = (event for event in events if isinstance(event, Warned))
    assert warning.message == (
        f"The model in {tmp_path} has 2 parts: sparse/0 and sparse/1 were joined, 8 photos in all."
    )


def test_sub_models_whose_common_photos_contradict_each_other_are_not_joined(room: Scene, tmp_path: Path) -> None:
    other = moved(room, 3, 8)
    shuffled = tuple(
        replace(camera, photo=room.cameras[3 + (index + 1) % 5].photo) for index, camera in enumerate(other.cameras)
    )
    write_colmap(part(room, 0, 5), tmp_path / "sparse" / "0", ORIGIN)
    write_colmap(Scene(room.photo_set, shuffled), tmp_path / "sparse" / "1", ORIGIN)
    events: list[object] = []
    found = read_cameras(tmp_path, room.photo_set, emit=events.append)
    assert len(found.cameras) == 5
    assert "sparse/1 with 3 more photos" in next(event.message for event in events if isinstance(event, Warned))


def test_the_place_whose_pictures_are_the_photos_is_preferred(room: Scene, tmp_path: Path) -> None:
    """A project of 3D Gaussian Splatting has the model of the photos in `distorted` and one of undistorted pictures."""
    undistorted = tuple(replace(camera, params=(390.0, 190.0, 140.0, 0.0)) for camera in room.cameras)
    write_colmap(Scene(room.photo_set, undistorted), tmp_path / "sparse" / "0", ORIGIN, scale=1)
    cropped = tmp_path / "sparse" / "0" / "cameras.bin"
    # Another size, as undistortion gives it: width and height of the only camera.
    data = cropped.read_bytes()
    cropped.write_bytes(data[:16] + struct.pack("<QQ", 410, 350) + data[32:])
    write_colmap(room, tmp_path / "distorted" / "sparse" / "0", ORIGIN)
    assert_true(read_cameras(tmp_path, room.photo_set), room, ORIGIN)


def test_a_damaged_sub_model_is_told_and_the_others_are_used(room: Scene, tmp_path: Path) -> None:
    write_colmap(part(room, 3, 8), tmp_path / "sparse" / "0", ORIGIN)
    damaged = write_colmap(part(room, 0, 3), tmp_path / "sparse" / "1", ORIGIN)
    (damaged / "images.bin").write_bytes(b"")
    events: list[object] = []
    assert len(read_cameras(tmp_path, room.photo_set, emit=events.append).cameras) == 5
    (warning,) = (event for event in events if isinstance(event, Warned))
    assert re.search(r"A part of the model .* is not used\. .*images\.bin", warning.message)


def test_a_picture_that_may_be_several_photos_is_refused_with_their_names(room: Scene, tmp_path: Path) -> None:
    photos = tuple(Photo(f"{folder}/00.png", WIDTH, HEIGHT, None, "") for folder in ("left", "right"))
    model = write_colmap(part(room, 0, 1), tmp_path / "model", ORIGIN)
    with pytest.raises(CameraError, match=r"they are: 00\.png may be left/00\.png or right/00\.png\. Keep"):
        read_cameras(model, PhotoSet(tmp_path, photos, ()))


def test_a_joined_camera_sees_the_points_of_both_parts(room: Scene, tmp_path: Path) -> None:
    write_colmap(part(room, 0, 5), tmp_path / "sparse" / "0", ORIGIN)
    write_colmap(moved(room, 3, 8), tmp_path / "sparse" / "1", ORIGIN)
    found = read_cameras(tmp_path, room.photo_set)
    pixels, _ = project(found.cameras[7], found.points[: len(POINTS)].astype(np.float64))
    expected, _ = project(room.cameras[7], POINTS)
    assert np.abs(pixels - expected).max() < 0.05
