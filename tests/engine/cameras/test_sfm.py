"""Cameras are estimated from photos alone, in an upright world."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image

from benchmarks.camera_health.sources import boxes
from engine.cameras import lens_groups
from engine.cameras import sfm as sfm_module
from engine.cameras.features import SfmWorkspace
from engine.cameras.reconstruction import rounded
from engine.cameras.settings import CameraSettings
from engine.cameras.sfm import estimate_cameras, other_groups_text
from engine.cameras.undistortion import project
from engine.core.errors import CameraError, Cancelled, DiskError, SettingsError
from engine.core.events import Event, Progress, Warned
from engine.core.system import CODE_ROOT
from engine.photos.reading import read_photos
from engine.photos.settings import PhotoSettings
from engine.scene import FISHEYE_LENS, write_camera_set
from engine.scene.camera import CameraSet
from engine.scene.photo import PhotoSet

from .conftest import Scene, make_scene, render, room_cameras

QUICK = CameraSettings(max_side=400, max_features=1000, first_octave=0)


@pytest.fixture(scope="module")
def found(room: Scene, tmp_path_factory: pytest.TempPathFactory) -> tuple[CameraSet, list[Event]]:
    events: list[Event] = []
    camera_set = estimate_cameras(room.photo_set, tmp_path_factory.mktemp("sfm"), QUICK, emit=events.append)
    return camera_set, events


def similarity_to_truth(camera_set: CameraSet, scene: Scene) -> tuple[np.ndarray, float]:
    """Return the similarity from the estimated to the true camera positions, and the largest remaining distance."""
    truth = {camera.photo: camera.center for camera in scene.cameras}
    a = np.array([camera.center for camera in camera_set.cameras])
    b = np.array([truth[camera.photo] for camera in camera_set.cameras])
    u, d, vt = np.linalg.svd((b - b.mean(0)).T @ (a - a.mean(0)))
    sign = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    similarity = np.eye(4)
    similarity[:3, :3] = (d @ np.diag(sign)) / np.square(a - a.mean(0)).sum() * (u @ sign @ vt)
    similarity[:3, 3] = b.mean(0) - similarity[:3, :3] @ a.mean(0)
    left = np.linalg.norm(a @ similarity[:3, :3].T + similarity[:3, 3] - b, axis=1)
    return similarity, float(left.max())


def test_every_photo_is_placed_where_it_was_taken(found: tuple[CameraSet, list[Event]], room: Scene) -> None:
    camera_set, _ = found
    assert [camera.photo for camera in camera_set.cameras] == [camera.photo for camera in room.cameras]
    assert camera_set.unregistered == ()
    assert not camera_set.poses_given
    assert camera_set.reprojection_error < 0.7
    _, worst = similarity_to_truth(camera_set, room)
    assert worst < 0.03  # for an arc of radius 3.2; largest seen 0.008
    focal = camera_set.cameras[0].params[0]
    assert focal == pytest.approx(380.0, rel=0.02)


def test_the_world_is_upright_right_handed_centred_and_of_unit_size(
    found: tuple[CameraSet, list[Event]], room: Scene
) -> None:
    camera_set, _ = found
    similarity, _ = similarity_to_truth(camera_set, room)
    up = similarity[:3, :3] @ (0.0, 0.0, 1.0)
    # The true world is Z up: no flip, and at most a degree of tilt for cameras that are rolled by a degree.
    assert up[2] / np.linalg.norm(up) > np.cos(np.radians(1.5))
    assert np.linalg.det(camera_set.original_from_world[:3, :3]) > 0
    distances = [np.linalg.norm(camera.center) for camera in camera_set.cameras]
    assert np.median(distances) == pytest.approx(1.0)


def test_points_lie_in_front_of_the_cameras_and_have_colours(found: tuple[CameraSet, list[Event]]) -> None:
    camera_set, _ = found
    assert len(camera_set.points) > 300
    assert camera_set.points.dtype == np.float32
    assert camera_set.point_colors.shape == camera_set.points.shape
    assert camera_set.point_colors.std() > 10
    for camera in camera_set.cameras:
        pixels, depth = project(camera, camera_set.points)
        assert (depth > 0).mean() > 0.95
        inside = ((pixels > 0) & (pixels < (camera.width, camera.height))).all(axis=1)
        assert inside.mean() > 0.3


def test_progress_rises_to_one(found: tuple[CameraSet, list[Event]]) -> None:
    fractions = [event.fraction for event in found[1] if isinstance(event, Progress)]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0


STORING = """
import sys
from dataclasses import replace
from pathlib import Path
from engine.cameras.reconstruction import rounded
from engine.cameras.settings import CameraSettings
from engine.cameras.sfm import estimate_cameras
from engine.photos.reading import read_photos
from engine.scene import write_camera_set
settings = CameraSettings(max_side=400, max_features=1000, first_octave=0, threads=int(sys.argv[4]))
write_camera_set(Path(sys.argv[3]), estimate_cameras(read_photos(Path(sys.argv[1])), Path(sys.argv[2]), settings))
"""


def test_any_number_of_threads_here_and_in_linear_algebra_stores_the_same_bytes(
    room: Scene, found: tuple[CameraSet, list[Event]], tmp_path: Path
) -> None:
    """`found` was estimated with a thread for each core."""
    write_camera_set(tmp_path, found[0])
    stored = [bytes_of(tmp_path)]
    for threads in ("1", "4"):
        folder, work = tmp_path / f"cameras {threads}", tmp_path / f"work {threads}"
        folder.mkdir()
        names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
        subprocess.run(
            [sys.executable, "-c", STORING, room.photo_set.folder, work, folder, threads],
            env={**os.environ, **dict.fromkeys(names, threads)}, cwd=CODE_ROOT, check=True,
        )  # fmt: skip
        stored.append(bytes_of(folder))
    assert stored[0] == stored[1] == stored[2]


def bytes_of(folder: Path) -> bytes:
    """The stored cameras and points."""
    return (folder / "cameras.json").read_bytes() + (folder / "points.npz").read_bytes()


def test_cameras_that_differ_in_their_last_bits_are_stored_as_the_same(found: tuple[CameraSet, list[Event]]) -> None:
    camera_set, _ = found
    rng = np.random.default_rng(0)

    def nearly(values: np.ndarray) -> np.ndarray:
        return values * (1.0 + rng.normal(0.0, 1e-15, values.shape))

    cameras = tuple(
        replace(camera, viewmat=nearly(camera.viewmat), params=tuple(nearly(np.array(camera.params)).tolist()))
        for camera in camera_set.cameras
    )
    again = rounded(replace(camera_set, cameras=cameras, original_from_world=nearly(camera_set.original_from_world)))
    assert not any(np.array_equal(a.viewmat, b.viewmat) for a, b in zip(cameras, camera_set.cameras, strict=True))
    for a, b in zip(again.cameras, camera_set.cameras, strict=True):
        assert np.array_equal(a.viewmat, b.viewmat) and a.params == b.params
    assert np.array_equal(again.original_from_world, camera_set.original_from_world)


def test_many_photos_that_show_things_in_several_sizes_are_mapped_once_and_some_with_other_lenses(
    room: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mapped: list[int] = []

    def counted(workspace: SfmWorkspace, names: Sequence[str], *others: Any) -> list[pycolmap.Reconstruction]:
        mapped.append(len(names))
        return map_photos(workspace, names, *others)

    map_photos = sfm_module._map
    monkeypatch.setattr(sfm_module, "_map", counted)
    monkeypatch.setattr(lens_groups, "size_gap", lambda _: 2.0)
    monkeypatch.setattr(lens_groups, "_SAMPLE", 5)
    found = estimate_cameras(room.photo_set, tmp_path, QUICK)
    # The few are mapped in a thread of their own.
    assert mapped.count(0) == 1 and set(mapped) == {0, 5}
    assert len(found.cameras) == len(room.cameras) and len({camera.params for camera in found.cameras}) == 1
    assert not [path.name for path in tmp_path.iterdir() if "beside" in path.name or path.name.startswith("trial-")]


def test_disk_without_room_for_a_sample_ends_no_run(
    room: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(self: SfmWorkspace) -> SfmWorkspace:
        (tmp_path / "database.db.beside").touch()
        raise DiskError("The disk is full.")

    monkeypatch.setattr(SfmWorkspace, "mapped_beside", full)
    monkeypatch.setattr(lens_groups, "size_gap", lambda _: 2.0)
    monkeypatch.setattr(lens_groups, "_SAMPLE", 5)
    found = estimate_cameras(room.photo_set, tmp_path, QUICK)
    assert len(found.cameras) == len(room.cameras) and not (tmp_path / "database.db.beside").exists()
    assert "The disk is full. Other lenses are tried on all photos." in caplog.messages


@pytest.mark.parametrize("count", [1, 2])
def test_one_or_two_photos_are_refused_at_once(room: Scene, tmp_path: Path, count: int) -> None:
    few = PhotoSet(room.photo_set.folder, room.photo_set.photos[:count], ())
    with pytest.raises(CameraError, match=f"cannot be found from {count} photos?: at least 3 that overlap are needed"):
        estimate_cameras(few, tmp_path, QUICK)
    assert list(tmp_path.iterdir()) == []


def test_the_error_for_photos_that_do_not_overlap_names_the_likely_causes(tmp_path: Path) -> None:
    camera = room_cameras(1)[0]
    (tmp_path / "photos").mkdir()
    for seed in range(1, 4):
        Image.fromarray(render(camera, seed)).save(tmp_path / "photos" / f"{seed}.png")
    with pytest.raises(CameraError, match="overlap"):
        estimate_cameras(read_photos(tmp_path / "photos"), tmp_path / "sfm", QUICK)


def test_the_error_for_photos_without_texture_says_so(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    for index in range(3):
        ramp = np.linspace(60, 180 + index, 400)[None, :, None].repeat(300, 0).repeat(3, 2)
        Image.fromarray(ramp.astype(np.uint8)).save(tmp_path / "photos" / f"{index}.png")
    with pytest.raises(CameraError, match="too little texture or are blurred"):
        estimate_cameras(read_photos(tmp_path / "photos"), tmp_path / "sfm", QUICK)


def test_a_photo_of_another_place_is_listed_as_unregistered(room: Scene, tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    shutil.copytree(room.photo_set.folder, folder)
    Image.fromarray(render(room.cameras[0], seed=5)).save(folder / "elsewhere.png")
    camera_set = estimate_cameras(read_photos(folder), tmp_path / "sfm", QUICK)
    assert camera_set.unregistered == ("elsewhere.png",)
    assert len(camera_set.cameras) == 8


def test_a_photo_without_any_feature_in_a_large_set_is_listed_as_unregistered(room: Scene, tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    shutil.copytree(room.photo_set.folder, folder)
    ramp = np.linspace(60, 180, 400)[None, :, None].repeat(300, 0).repeat(3, 2)
    Image.fromarray(ramp.astype(np.uint8)).save(folder / "wall.png")
    # A set of eight or more counts as large here: pairs are selected by features instead of matching all.
    photo_set = read_photos(folder, PhotoSettings(blur_ratio=0.0))
    camera_set = estimate_cameras(photo_set, tmp_path / "sfm", replace(QUICK, exhaustive_up_to=4))
    assert camera_set.unregistered == ("wall.png",)


def test_photos_of_other_sizes_orientations_and_lenses_get_their_own_lens(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    cameras = room_cameras(9)
    make_scene(folder, cameras)
    for index in (1, 4, 7):
        # Another camera: a longer lens with fewer pixels, in portrait orientation with an EXIF tag.
        name = folder / cameras[index].photo
        picture = Image.open(name).crop((80, 30, 320, 270)).resize((216, 216), Image.Resampling.LANCZOS)
        exif = picture.getexif()
        exif[0x0112] = 6
        picture.transpose(Image.Transpose.ROTATE_90).save(name.with_suffix(".jpg"), exif=exif, quality=97)
        name.unlink()
    camera_set = estimate_cameras(read_photos(folder), tmp_path / "sfm", QUICK)
    assert len(camera_set.cameras) >= 8
    wide = {camera.params for camera in camera_set.cameras if camera.width == 400}
    square = {camera.params for camera in camera_set.cameras if camera.width == 216}
    assert len(wide) == len(square) == 1
    assert next(iter(square))[0] == pytest.approx(380.0 * 0.9, rel=0.05)


@pytest.fixture
def four(room: Scene, tmp_path: Path) -> PhotoSet:
    """Half of the photos of the room, with a quarter of the pairs, in a folder of their own."""
    (tmp_path / "photos").mkdir()
    for photo in room.photo_set.photos[:4]:
        shutil.copyfile(room.photo_set.folder / photo.name, tmp_path / "photos" / photo.name)
    return read_photos(tmp_path / "photos")


def test_cancel_stops_soon_and_the_next_run_resumes(four: PhotoSet, tmp_path: Path) -> None:
    events: list[Event] = []

    def stop() -> bool:
        return any(isinstance(event, Progress) and "matched" in event.message for event in events)

    with pytest.raises(Cancelled):
        estimate_cameras(four, tmp_path / "sfm", QUICK, emit=events.append, should_stop=stop)
    events.clear()
    assert len(estimate_cameras(four, tmp_path / "sfm", QUICK, emit=events.append).cameras) == 4
    # Features were kept: no detection is reported.
    assert not any("features in" in event.message for event in events if isinstance(event, Progress))


def test_colmap_ends_when_the_event_receiver_fails(four: PhotoSet, tmp_path: Path) -> None:
    def emit(event: Event) -> None:
        if isinstance(event, Progress) and "placed" in event.message:
            raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        estimate_cameras(four, tmp_path / "sfm", QUICK, emit=emit)
    assert len(estimate_cameras(four, tmp_path / "sfm", QUICK).cameras) == 4


KILLED = """
import os, signal, sys
from pathlib import Path
from engine.cameras.settings import CameraSettings
from engine.cameras.sfm import estimate_cameras
from engine.photos.reading import read_photos
messages = []
def emit(event):
    messages.append(getattr(event, "message", ""))
def should_stop():
    # Asked by the thread that waits for COLMAP, while COLMAP works on what the last message says.
    if sys.argv[3] in messages[-1]:
        os.kill(os.getpid(), signal.SIGKILL)
    return False
settings = CameraSettings(max_side=400, max_features=1000, first_octave=0)
photos = read_photos(Path(sys.argv[1]))
estimate_cameras(photos, Path(sys.argv[2]), settings, emit=emit, should_stop=should_stop)
"""


@pytest.mark.skipif(os.name == "nt", reason="kill -9 is POSIX")
@pytest.mark.parametrize("message", ["features in", "matched"])
def test_a_killed_run_is_resumed(four: PhotoSet, tmp_path: Path, message: str) -> None:
    words = [sys.executable, "-c", KILLED, four.folder, tmp_path / "sfm", message]
    assert subprocess.run(words, cwd=CODE_ROOT, check=False).returncode == -signal.SIGKILL
    assert len(estimate_cameras(four, tmp_path / "sfm", QUICK).cameras) == 4


def test_other_photos_start_a_new_run_and_colmap_writes_nothing_to_the_terminal(
    room: Scene, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    fewer = PhotoSet(room.photo_set.folder, room.photo_set.photos[:4], ())
    assert len(estimate_cameras(fewer, tmp_path, QUICK).cameras) == 4
    other = PhotoSet(room.photo_set.folder, room.photo_set.photos[3:7], ())
    assert [camera.photo for camera in estimate_cameras(other, tmp_path, QUICK).cameras] == [
        photo.name for photo in other.photos
    ]
    captured = capfd.readouterr()
    assert (captured.out, captured.err) == ("", "")


def test_settings_out_of_bounds_are_refused() -> None:
    with pytest.raises(SettingsError, match="`CameraSettings.min_registered` must be at least 3, got 2"):
        CameraSettings(min_registered=2)


@pytest.mark.slow
@pytest.mark.data
def test_all_photos_of_the_real_statue_are_placed(data_folder: Path, tmp_path: Path) -> None:
    warnings: list[Event] = []
    photo_set = read_photos(data_folder / "sakharov_statue32" / "photos")
    # Every second photo of half of the way around, at a quarter of the pairs of the whole way.
    around = PhotoSet(photo_set.folder, photo_set.photos[:16:2], ())
    camera_set = estimate_cameras(
        around, tmp_path, emit=lambda event: warnings.append(event) if isinstance(event, Warned) else None
    )
    assert len(camera_set.cameras) == len(around.photos) == 8
    assert camera_set.reprojection_error < 0.5
    assert len(camera_set.points) > 300  # 414 seen
    assert warnings == []
    # The photos of the statue were taken upright: the upper edges of the pictures point up.
    ups = -np.array([camera.viewmat[1, :3] for camera in camera_set.cameras])
    assert (ups[:, 2] > 0.9).all()


@pytest.mark.slow
@pytest.mark.data
def test_photos_with_an_exif_focal_length_are_placed(data_folder: Path, tmp_path: Path) -> None:
    photo_set = read_photos(data_folder / "banana16" / "photos")
    assert photo_set.photos[0].focal_px is not None
    # Half of the photos and fewer features are enough for a focal length. Two of them overlap little with the others.
    few = PhotoSet(photo_set.folder, photo_set.photos[:8], ())
    camera_set = estimate_cameras(few, tmp_path, CameraSettings(first_octave=0))
    assert len(camera_set.cameras) >= 5
    # The estimated focal length is close to that of EXIF.
    assert camera_set.cameras[0].params[0] == pytest.approx(photo_set.photos[0].focal_px, rel=0.1)


def test_photos_of_other_scenes_are_named_group_by_group_with_what_to_do() -> None:
    text = other_groups_text(9, [{"d.jpg", "c.jpg"}, {"b.jpg", "a.jpg", "c.jpg"}, {"c.jpg"}])
    assert text.startswith(
        "The photos fall into 3 groups that no photo connects, and the largest with 9 photos is used"
    )
    assert "folder of its own" in text
    # A photo of two groups stands in the larger one.
    assert text.endswith("group 2 (3 photos): a.jpg, b.jpg, c.jpg; group 3 (1 photo): d.jpg.")
    assert other_groups_text(9, [set(), set()]) == ""


def test_a_fisheye_lens_is_estimated_when_it_is_chosen(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    boxes(9, "fisheye", focal=150.0, size=(400, 300), count=8, turn=2.0)(tmp_path / "photos")
    photos = read_photos(tmp_path / "photos", PhotoSettings().for_lens(FISHEYE_LENS, is_given=False))
    # With half as many features, one photo is placed wrong on some processors, and left out.
    settings = replace(QUICK, model=FISHEYE_LENS, first_octave=-1, max_features=2000)
    found = estimate_cameras(photos, tmp_path / "sfm", settings)
    assert len(found.cameras) == 8
    # The lens is exactly equidistant. From the first guess of 160 pixels, matches of half a pixel lead this near.
    assert found.cameras[0].params[0] == pytest.approx(150.0, rel=0.01)
    assert found.health is not None and found.health.colour == "green"
