"""Camera poses supplied by the user are used as given: COLMAP models and transforms.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from engine.cameras.given import read_cameras
from engine.cameras.settings import CameraSettings
from engine.cameras.undistortion import project
from engine.core.arrays import Float64
from engine.core.errors import CameraError, FormatError
from engine.scene.camera import Camera, CameraSet
from engine.scene.photo import Photo, PhotoSet

from .conftest import HEIGHT, LENS, WIDTH, Scene

QUICK = CameraSettings(max_side=400, max_features=1000, first_octave=0)
ORIGIN = np.zeros(3)
GEOREFERENCED = np.array([5e5, 4.5e6, 120.0])
POINTS = np.random.default_rng(0).uniform((0.2, 0.2, 0.0), (1.9, 1.9, 1.0), (50, 3))


def write_colmap(
    scene: Scene, folder: Path, shift: Float64, *, text: bool = False, scale: int = 1, prefix: str = ""
) -> Path:
    model = pycolmap.Reconstruction()
    lens = pycolmap.Camera(model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, params=list(LENS))
    lens.rescale(WIDTH // scale, HEIGHT // scale)
    lens.camera_id = 1
    model.add_camera_with_trivial_rig(lens)
    for index, camera in enumerate(scene.cameras, start=1):
        rotation = camera.viewmat[:3, :3]
        pose = pycolmap.Rigid3d(
            pycolmap.Rotation3d(np.ascontiguousarray(rotation)), -rotation @ (camera.center + shift)
        )
        image = pycolmap.Image(name=prefix + camera.photo, camera_id=1, image_id=index)
        model.add_image_with_trivial_frame(image, pose)
    for point in POINTS:
        model.add_point3D(point + shift, pycolmap.Track(), np.array([10, 20, 30], np.uint8))
    folder.mkdir(parents=True)
    if text:
        model.write_text(folder)
    else:
        model.write_binary(folder)
    return folder


def transforms(scene: Scene, shift: Float64) -> dict[str, Any]:
    """Return the scene as nerfstudio writes it: OpenGL axes, camera-to-world."""
    frames = []
    for camera in scene.cameras:
        matrix = np.eye(4)
        matrix[:3, :3] = camera.viewmat[:3, :3].T @ np.diag([1.0, -1.0, -1.0])
        matrix[:3, 3] = camera.center + shift
        frames.append({"file_path": f"./images/{camera.photo}", "transform_matrix": matrix.tolist()})
    f, cx, cy, k = LENS
    return {"w": WIDTH, "h": HEIGHT, "fl_x": f, "fl_y": f, "cx": cx, "cy": cy, "k1": k, "frames": frames}


def write_transforms(folder: Path, data: dict[str, Any]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "transforms.json").write_text(json.dumps(data))
    return folder / "transforms.json"


def assert_true(camera_set: CameraSet, scene: Scene, shift: Float64) -> None:
    """Check that the cameras project points like the true cameras, and that the frame of the file is restored."""
    similarity = camera_set.original_from_world
    scale = np.cbrt(np.linalg.det(similarity[:3, :3]))
    assert np.median([np.linalg.norm(camera.center) for camera in camera_set.cameras]) == pytest.approx(1.0)
    world = (POINTS + shift - similarity[:3, 3]) @ np.linalg.inv(similarity[:3, :3]).T
    truth = {camera.photo: camera for camera in scene.cameras}
    for camera in camera_set.cameras:
        true = truth[camera.photo]
        assert (camera.width, camera.height) == (WIDTH, HEIGHT)
        back = similarity[:3, :3] @ camera.center + similarity[:3, 3]
        assert np.abs(back - true.center - shift).max() < 1e-6
        pixels, depth = project(camera, world)
        true_pixels, true_depth = project(true, POINTS)
        assert np.abs(pixels - true_pixels).max() < 0.01
        assert np.allclose(depth * scale, true_depth, atol=1e-6)
    # The scene is Z up, which the photos show.
    up = similarity[:3, 2] / np.linalg.norm(similarity[:3, 2])
    assert up[2] > np.cos(np.radians(2.0))


@pytest.mark.parametrize("shift", [ORIGIN, GEOREFERENCED], ids=["local", "georeferenced"])
@pytest.mark.parametrize("text", [False, True], ids=["binary", "text"])
def test_a_colmap_model_is_read(room: Scene, tmp_path: Path, shift: Float64, text: bool) -> None:
    camera_set = read_cameras(write_colmap(room, tmp_path / "model", shift, text=text), room.photo_set)
    assert len(camera_set.cameras) == 8
    assert camera_set.poses_given
    assert len(camera_set.points) == len(POINTS)
    assert camera_set.point_colors[0].tolist() == [10, 20, 30]
    assert_true(camera_set, room, shift)


@pytest.mark.parametrize("place", ["sparse/0", "sparse", "0"])
def test_the_model_is_found_in_its_usual_places(room: Scene, tmp_path: Path, place: str) -> None:
    write_colmap(room, tmp_path / place, ORIGIN)
    assert len(read_cameras(tmp_path, room.photo_set).cameras) == 8


def test_a_model_of_smaller_pictures_in_another_folder_is_scaled_to_the_photos(room: Scene, tmp_path: Path) -> None:
    model = write_colmap(room, tmp_path / "model", ORIGIN, scale=2, prefix="images_2/")
    assert_true(read_cameras(model, room.photo_set), room, ORIGIN)


@pytest.mark.parametrize("shift", [ORIGIN, GEOREFERENCED], ids=["local", "georeferenced"])
def test_transforms_json_is_read_and_its_points_are_triangulated(room: Scene, tmp_path: Path, shift: Float64) -> None:
    file = write_transforms(tmp_path, transforms(room, shift))
    camera_set = read_cameras(file, room.photo_set, QUICK, folder=tmp_path / "work")
    assert_true(camera_set, room, shift)
    similarity = camera_set.original_from_world
    points = camera_set.points.astype(np.float64) @ similarity[:3, :3].T + similarity[:3, 3] - shift
    # Every point lies on the floor or a wall of the room.
    off = np.abs(np.stack([points[:, 2], points[:, 0] - 2.0, points[:, 1] - 2.0])).min(axis=0)
    assert len(points) > 300
    assert np.median(off) < 0.005
    assert camera_set.reprojection_error < 1.0


def test_a_point_cloud_beside_transforms_json_is_used(room: Scene, tmp_path: Path) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 2\n" + "".join(
        f"property {kind} {name}\n"
        for kind, name in (
            ("float", "x"),
            ("float", "y"),
            ("float", "z"),
            ("uchar", "red"),
            ("uchar", "green"),
            ("uchar", "blue"),
        )
    )
    (tmp_path / "sparse_pc.ply").write_text(header + "end_header\n1 1 0 255 0 0\n0.5 1 0.2 0 255 0\n")
    file = write_transforms(tmp_path, {**transforms(room, ORIGIN), "ply_file_path": "sparse_pc.ply"})
    camera_set = read_cameras(file, room.photo_set)
    similarity = camera_set.original_from_world
    points = camera_set.points @ similarity[:3, :3].T + similarity[:3, 3]
    assert np.allclose(points, [[1, 1, 0], [0.5, 1, 0.2]], atol=1e-5)
    assert camera_set.point_colors.tolist() == [[255, 0, 0], [0, 255, 0]]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"fl_x": 380.0}, ("PINHOLE", (380.0, 380.0, 200.0, 150.0))),
        ({"camera_angle_x": 2 * np.arctan(200.0 / 380.0)}, ("PINHOLE", (380.0, 380.0, 200.0, 150.0))),
        ({"fl_x": 760.0, "w": 800, "h": 600, "cx": 410.0}, ("PINHOLE", (380.0, 380.0, 205.0, 150.0))),
        (
            {"fl_x": 380.0, "k1": 0.1, "k2": 0.2, "p1": 0.3, "p2": 0.4},
            ("OPENCV", (380.0, 380.0, 200.0, 150.0, 0.1, 0.2, 0.3, 0.4)),
        ),
        (
            {"fl_x": 380.0, "camera_model": "OPENCV_FISHEYE", "k1": 0.1, "k4": 0.4},
            ("OPENCV_FISHEYE", (380.0, 380.0, 200.0, 150.0, 0.1, 0.0, 0.0, 0.4)),
        ),
    ],
)
@pytest.mark.parametrize("per_frame", [False, True])
def test_lens_values_may_be_given_for_all_frames_or_for_each(
    room: Scene, tmp_path: Path, values: dict[str, Any], expected: tuple[str, tuple[float, ...]], per_frame: bool
) -> None:
    frames = transforms(room, ORIGIN)["frames"][:1]
    data = {"frames": [{**frames[0], **values}]} if per_frame else {**values, "frames": frames}
    camera = read_cameras(write_transforms(tmp_path, data), room.photo_set).cameras[0]
    assert camera.model == expected[0]
    assert camera.params == pytest.approx(expected[1])


def test_photos_without_a_camera_are_listed(room: Scene, tmp_path: Path) -> None:
    data = transforms(room, ORIGIN)
    data["frames"] = data["frames"][:1]
    camera_set = read_cameras(write_transforms(tmp_path, data), room.photo_set)
    assert len(camera_set.cameras) == 1
    assert camera_set.unregistered == tuple(camera.photo for camera in room.cameras[1:])


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"transform_matrix": [[1, 0], [0, 1]]}, "4 rows of 4 finite numbers"),
        ({"transform_matrix": np.diag([2.0, 2.0, 2.0, 1.0]).tolist()}, "scaled or skewed"),
        ({"transform_matrix": np.diag([1.0, 1.0, -1.0, 1.0]).tolist()}, "mirrored"),
        ({"transform_matrix": [[1, 0, 0, 0], [0, 1], [], [0]]}, "4 rows of 4 finite numbers"),
        ({"transform_matrix": np.diag([1.0, 1.0, 1e-9, 1.0]).tolist()}, "scaled or skewed"),
        ({"transform_matrix": np.zeros((4, 4)).tolist()}, "scaled or skewed"),
        ({"transform_matrix": np.full((4, 4), 1e300).tolist()}, "4 rows of 4 finite numbers"),
        ({"fl_x": 0.0}, "must be positive"),
        ({"fl_x": 1e300}, "all lens values finite"),
        ({"w": 0, "h": 0}, "cannot have 0 x 0 pixels"),
        ({"w": WIDTH, "h": WIDTH}, "cropped or other pictures"),
        ({"camera_model": "EQUIRECTANGULAR"}, "is not supported"),
    ],
)
def test_the_error_for_an_invalid_frame_names_it(
    room: Scene, tmp_path: Path, change: dict[str, Any], sentence: str
) -> None:
    data = transforms(room, ORIGIN)
    data["frames"][3].update(change)
    with pytest.raises(CameraError, match=rf"03\.png.*{sentence}"):
        read_cameras(write_transforms(tmp_path, data), room.photo_set)


@pytest.mark.parametrize("angle", [0.0, -1.0, 4.0])
def test_impossible_angle_of_view_is_refused(room: Scene, tmp_path: Path, angle: float) -> None:
    data = {"camera_angle_x": angle, "frames": transforms(room, ORIGIN)["frames"]}
    with pytest.raises(CameraError, match="its angle of view must be above 0 and below 180 degrees"):
        read_cameras(write_transforms(tmp_path, data), room.photo_set)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"frames": [1]}', '{"frames": [{}]}'])
def test_a_file_that_is_not_a_transforms_json_is_refused(room: Scene, tmp_path: Path, text: str) -> None:
    (tmp_path / "transforms.json").write_text(text)
    with pytest.raises(FormatError, match=r"transforms\.json cannot be read: .* Choose a transforms\.json of"):
        read_cameras(tmp_path, room.photo_set)


def test_point_cloud_outside_of_the_folder_of_transforms_json_is_not_read(room: Scene, tmp_path: Path) -> None:
    (tmp_path / "secret.ply").write_text("ply\n")
    file = write_transforms(tmp_path / "model", {**transforms(room, ORIGIN), "ply_file_path": "../secret.ply"})
    with pytest.raises(CameraError, match="`ply_file_path` in .* leads out of its folder"):
        read_cameras(file, room.photo_set)


def test_missing_and_foreign_models_are_refused(room: Scene, tmp_path: Path) -> None:
    with pytest.raises(CameraError, match="does not exist"):
        read_cameras(tmp_path / "missing", room.photo_set)
    with pytest.raises(CameraError, match="contains no camera model"):
        read_cameras(tmp_path, room.photo_set)
    model = write_colmap(room, tmp_path / "model", ORIGIN)
    foreign = PhotoSet(tmp_path, (Photo("other.jpg", WIDTH, HEIGHT, None, ""),), ())
    with pytest.raises(
        CameraError, match=r"None of the pictures in .* for example, 00\.png, the photo folder other\.jpg"
    ):
        read_cameras(model, foreign)
    cropped = PhotoSet(tmp_path, (Photo("00.png", WIDTH, WIDTH, None, ""),), ())
    with pytest.raises(CameraError, match="made from cropped or other pictures"):
        read_cameras(model, cropped)


def test_a_lens_that_the_project_could_not_read_again_is_refused_before_it_is_stored(
    room: Scene, tmp_path: Path
) -> None:
    model = write_colmap(room, tmp_path / "model", ORIGIN, text=True)
    lens = f"1 PINHOLE {WIDTH} {HEIGHT} 1e-20 {LENS[0]} {WIDTH / 2} {HEIGHT / 2}"
    (model / "cameras.txt").write_text(lens + "\n")
    with pytest.raises(CameraError, match="its focal length must be above 0. Correct it, or let the cameras"):
        read_cameras(model, room.photo_set, QUICK)


def test_a_camera_is_not_mirrored(room: Scene, tmp_path: Path) -> None:
    """A point to the right of the axis and above it appears to the right and above."""
    camera: Camera = read_cameras(write_colmap(room, tmp_path / "m", ORIGIN), room.photo_set).cameras[2]
    right, down, forward = camera.viewmat[:3, :3]
    point = camera.center + forward + 0.2 * right - 0.1 * down
    pixels, depth = project(camera, point[None])
    assert depth[0] == pytest.approx(1.0)
    assert pixels[0, 0] > WIDTH / 2 + 50
    assert pixels[0, 1] < HEIGHT / 2 - 25
    assert np.linalg.det(camera.viewmat[:3, :3]) == pytest.approx(1.0)
    assert down[2] < -0.5  # world Z is up
