"""Cameras of pictures that a program saw as their files store them belong to the upright photos afterwards."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from numpy.typing import NDArray
from PIL import Image

from engine.cameras.given import read_cameras
from engine.cameras.settings import CameraSettings
from engine.cameras.turning import MIRRORED, ORIENTATIONS, turned_lens, turned_pixels, turned_viewmat
from engine.cameras.undistortion import project
from engine.core.arrays import Float64
from engine.core.errors import CameraError
from engine.photos import load_pixels, read_photos
from engine.photos.exif import UPRIGHT_TRANSPOSES
from engine.scene import Camera, Lens, PhotoSet, lens_pixels

from .conftest import HEIGHT, LENS, WIDTH, Scene
from .test_given import write_transforms

pytestmark = pytest.mark.usefixtures("readers_in_this_process")

BACK = {1: 1, 2: 2, 3: 3, 4: 4, 5: 5, 6: 8, 7: 7, 8: 6}
"""The orientation that undoes another."""
SQUARE = slice(50, 350)
"""Columns of the room's photos that make them square."""
LENSES = [
    Lens("SIMPLE_RADIAL", 400, 300, (380.0, 190.0, 160.0, -0.08)),
    Lens("PINHOLE", 400, 300, (380.0, 200.0, 200.0, 200.0)),
    Lens("OPENCV", 400, 300, (380.0, 390.0, 190.0, 160.0, 0.1, -0.05, 0.01, -0.02)),
    Lens("FULL_OPENCV", 400, 300, (380.0, 390.0, 190.0, 160.0, 0.1, -0.05, 0.01, -0.02, 0.01, 0.02, 0.01, 0.005)),
    Lens("THIN_PRISM_FISHEYE", 400, 300, (380.0, 390.0, 190.0, 160.0, 0.1, -0.05, 0.01, -0.02, 0.01, 0.02, 0.01, 0.03)),
    Lens("RAD_TAN_THIN_PRISM_FISHEYE", 400, 300, (380.0, 390.0, 190.0, 160.0, *np.linspace(-0.02, 0.02, 12))),
    Lens("EUCM", 400, 300, (380.0, 390.0, 190.0, 160.0, 0.6, 1.1)),
]


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_a_turned_lens_shows_what_the_turned_picture_shows(lens: Lens, orientation: int) -> None:
    points = np.random.default_rng(0).uniform((-0.3, -0.3, 1.0), (0.3, 0.3, 1.5), (30, 3))
    viewmat = turned_viewmat(np.eye(4), orientation)
    mirror = np.diag([-1.0, 1.0, 1.0]) if orientation in MIRRORED else np.eye(3)
    local = points @ mirror @ viewmat[:3, :3].T
    assert np.linalg.det(viewmat[:3, :3]) == pytest.approx(1.0)
    stored = lens_pixels(lens, points[:, :2] / points[:, 2:])
    upright = lens_pixels(turned_lens(lens, orientation), local[:, :2] / local[:, 2:])
    assert np.abs(upright - turned_pixels(stored, 400, 300, orientation)).max() < 1e-9


@pytest.mark.parametrize("orientation", UPRIGHT_TRANSPOSES)
def test_pixels_are_turned_as_pillow_turns_pictures(orientation: int) -> None:
    stored = np.zeros((3, 4), np.uint8)
    stored[1, 3] = 1
    upright = np.asarray(Image.fromarray(stored).transpose(UPRIGHT_TRANSPOSES[orientation]))
    x, y = turned_pixels(np.array([[3.5, 1.5]]), 4, 3, orientation)[0].astype(int)
    assert upright[y, x] == 1


def photos_with(scene: Scene, folder: Path, orientations: list[int], *, square: bool = False) -> PhotoSet:
    """Write the scene's photos as JPEG files that are stored turned, with the EXIF orientation that undoes it."""
    folder.mkdir()
    for camera, orientation in zip(scene.cameras, orientations, strict=True):
        picture = Image.fromarray(load_pixels(scene.photo_set.folder / camera.photo))
        if square:
            picture = picture.crop((SQUARE.start, 0, SQUARE.stop, HEIGHT))
        if orientation != 1:
            picture = picture.transpose(UPRIGHT_TRANSPOSES[BACK[orientation]])
        exif = Image.Exif()
        exif[0x0112] = orientation
        picture.save(folder / f"{Path(camera.photo).stem}.jpg", quality=95, exif=exif)
    return read_photos(folder)


def truth(scene: Scene, *, square: bool = False) -> list[Camera]:
    f, cx, cy, k = LENS
    width, left = (SQUARE.stop - SQUARE.start, SQUARE.start) if square else (WIDTH, 0)
    return [
        replace(camera, photo=f"{Path(camera.photo).stem}.jpg", width=width, params=(f, cx - left, cy, k))
        for camera in scene.cameras
    ]


def surface(cameras: list[Camera], photo_set: PhotoSet) -> tuple[Float64, NDArray[np.uint8]]:
    """Return points on the floor and the walls, with the colours that the middle photo shows."""
    rng = np.random.default_rng(1)
    points = rng.uniform((0.3, 0.3, 0.0), (1.99, 1.99, 1.2), (600, 3))
    points[:200, 2], points[200:400, 0], points[400:, 1] = 0.0, 2.0, 2.0
    camera = cameras[4]
    pixels, _ = project(camera, points)
    with np.errstate(invalid="ignore"):
        shown = ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=1)
    x, y = pixels[shown].astype(int).T
    return points[shown], load_pixels(photo_set.folder / camera.photo)[y, x]


def write_model(
    folder: Path, cameras: list[Camera], orientations: list[int], points: Float64, colors: NDArray[np.uint8]
) -> Path:
    """Write the COLMAP model of a program that sees each picture before `orientation` makes it upright."""
    model = pycolmap.Reconstruction()
    mirrored = any(orientation in MIRRORED for orientation in orientations)
    for number, (camera, orientation) in enumerate(zip(cameras, orientations, strict=True), start=1):
        stored = turned_lens(camera.lens, BACK[orientation])
        lens = pycolmap.Camera(model=stored.model, width=stored.width, height=stored.height, params=list(stored.params))
        lens.camera_id = number
        model.add_camera_with_trivial_rig(lens)
        viewmat = turned_viewmat(camera.viewmat, BACK[orientation])
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(np.ascontiguousarray(viewmat[:3, :3])), viewmat[:3, 3])
        image = pycolmap.Image(name=camera.photo, camera_id=number, image_id=number)
        model.add_image_with_trivial_frame(image, pose)
    for point, color in zip(points, colors, strict=True):
        model.add_point3D(point * ((-1, 1, 1) if mirrored else (1, 1, 1)), pycolmap.Track(), color)
    folder.mkdir()
    model.write_binary(folder)
    return folder


def assert_as_in(found: tuple[Camera, ...], true: list[Camera], points: Float64, world: Float64) -> None:
    """Check that each camera shows the points of its world where the true camera shows them."""
    for camera, expected in zip(found, true, strict=True):
        assert (camera.photo, camera.width, camera.height) == (expected.photo, expected.width, expected.height)
        pixels, depth = project(camera, world)
        expected_pixels, _ = project(expected, points)
        in_picture = (np.abs(expected_pixels - 150) < 100).all(axis=1)
        assert in_picture.sum() > 20
        # float32 points
        assert np.abs(pixels - expected_pixels)[in_picture].max() < 0.05
        assert (depth[in_picture] > 0).all()


@pytest.mark.parametrize("square", [False, True], ids=["oblong", "square"])
@pytest.mark.parametrize(
    "orientations",
    [[3, 1] * 4, [6, 1] * 4, [8, 6, 1, 3] * 2, [2] * 8, [4] * 8, [5] * 8, [7] * 8],
    ids=lambda orientations: "-".join(map(str, orientations[:4])),
)
def test_cameras_of_stored_pictures_are_turned_with_the_photos(
    room: Scene, tmp_path: Path, orientations: list[int], square: bool
) -> None:
    photo_set = photos_with(room, tmp_path / "photos", orientations, square=square)
    true = truth(room, square=square)
    points, colors = surface(true, photo_set)
    model = write_model(tmp_path / "model", true, orientations, points, colors)
    found = read_cameras(model, photo_set)
    assert_as_in(found.cameras, true, points, found.points.astype(np.float64))


@pytest.mark.parametrize("square", [False, True], ids=["oblong", "square"])
def test_cameras_of_upright_pictures_stay_though_the_files_are_stored_turned(
    room: Scene, tmp_path: Path, square: bool
) -> None:
    photo_set = photos_with(room, tmp_path / "photos", [3, 6, 1, 8] * 2, square=square)
    true = truth(room, square=square)
    points, colors = surface(true, photo_set)
    found = read_cameras(write_model(tmp_path / "model", true, [1] * 8, points, colors), photo_set)
    assert_as_in(found.cameras, true, points, found.points.astype(np.float64))


def test_cameras_of_photos_that_were_turned_and_saved_anew_are_turned_too(room: Scene, tmp_path: Path) -> None:
    """The photos have no orientation any more, but a program had placed them as they were stored before."""
    photo_set = photos_with(room, tmp_path / "photos", [1] * 8)
    true = truth(room)
    points, colors = surface(true, photo_set)
    model = write_model(tmp_path / "model", true, [3, 6, 8, 3, 6, 8, 3, 3], points, colors)
    found = read_cameras(model, photo_set)
    assert_as_in(found.cameras, true, points, found.points.astype(np.float64))


def test_mirrored_and_other_pictures_in_one_model_contradict_each_other(room: Scene, tmp_path: Path) -> None:
    orientations = [2, 2, 2, 2, 2, 2, 2, 1]
    photo_set = photos_with(room, tmp_path / "photos", orientations)
    true = truth(room)
    points, colors = surface(true, photo_set)
    mirrored = write_model(tmp_path / "model", true[:7], [2] * 7, points, colors)
    other = pycolmap.Reconstruction(mirrored)
    pose = pycolmap.Rigid3d(pycolmap.Rotation3d(np.ascontiguousarray(true[7].viewmat[:3, :3])), true[7].viewmat[:3, 3])
    other.add_image_with_trivial_frame(pycolmap.Image(name=true[7].photo, camera_id=1, image_id=8), pose)
    other.write_binary(mirrored)
    with pytest.raises(CameraError, match="contradict each other: that of 00.jpg is for a mirrored"):
        read_cameras(mirrored, photo_set)


def test_features_decide_where_a_model_has_no_points(room: Scene, tmp_path: Path) -> None:
    orientations = [3, 1, 3, 1, 1, 3, 1, 3]
    photo_set = photos_with(room, tmp_path / "photos", orientations)
    frames = []
    for camera, orientation in zip(truth(room), orientations, strict=True):
        viewmat = turned_viewmat(camera.viewmat, BACK[orientation])
        matrix = np.linalg.inv(viewmat) @ np.diag([1.0, -1.0, -1.0, 1.0])
        frames.append({"file_path": f"images/{camera.photo}", "transform_matrix": matrix.tolist()})
    f, cx, cy, k = LENS
    lens = {"w": WIDTH, "h": HEIGHT, "fl_x": f, "fl_y": f, "cx": cx, "cy": cy, "k1": k}
    file = write_transforms(tmp_path / "model", {**lens, "frames": frames})
    settings = CameraSettings(max_side=400, max_features=1000, first_octave=0)
    found = read_cameras(file, photo_set, settings)
    similarity = found.original_from_world
    for camera, true in zip(found.cameras, truth(room), strict=True):
        back = similarity[:3, :3] @ np.linalg.inv(camera.viewmat)[:3, :3]
        back /= np.cbrt(np.linalg.det(back))
        assert np.abs(back - true.viewmat[:3, :3].T).max() < 1e-6
    assert found.reprojection_error < 1.0
