"""Cameras that the photos refute are named with the likely cause, and sound ones give no alarm."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageOps

from benchmarks.camera_health.sources import boxes, zoomed
from engine.cameras.colmap import pycolmap
from engine.cameras.evidence import (
    Evidence,
    PairFit,
    epipolar_distances,
    is_turn,
    measure_model,
    missing_share,
    strongest_pairs,
)
from engine.cameras.feature_scales import SIZES_DIFFER, relative_scales, size_gap
from engine.cameras.given_check import check_given_cameras
from engine.cameras.health import judge, refuted_images
from engine.cameras.lens_groups import group_by_focal, lenses_differ
from engine.cameras.lens_trials import LensTrial, tried_apart, tried_lenses
from engine.cameras.mirrored import agreeing_as_mirrored, smaller_side
from engine.cameras.settings import CameraSettings
from engine.cameras.sfm import estimate_cameras
from engine.core.errors import CameraError, DiskError
from engine.core.events import Event, Progress, Warned, never_stop
from engine.photos.reading import read_photos
from engine.scene import CameraHealth, CameraSet

from .conftest import Scene, looking_at, make_scene, room_cameras

QUICK = CameraSettings(max_side=400, max_features=1000, first_octave=0)
SHARED = pycolmap.Camera(model="SIMPLE_RADIAL", width=640, height=480, params=[500.0, 320.0, 240.0, 0.0])
LensOf = Callable[[int], pycolmap.Camera]


def lens(model: str, *params: float) -> pycolmap.Camera:
    return pycolmap.Camera(model=model, width=640, height=480, params=list(params))


def model_of(true_lens: LensOf, noise: float = 0.2, step: float = 0.35) -> pycolmap.Reconstruction:
    """Return a model with the shared lens whose photos were taken with other lenses, from a ring around 150 points."""
    rng = np.random.default_rng(0)
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(model="SIMPLE_RADIAL", width=640, height=480, params=list(SHARED.params), camera_id=1)
    )
    points = rng.uniform(-1.0, 1.0, (150, 3))
    seen: dict[int, list[tuple[int, int]]] = {index: [] for index in range(len(points))}
    for image_id in range(1, 9):
        angle = step * image_id
        viewmat = looking_at(np.array([4 * np.cos(angle), 4 * np.sin(angle), 1.0 + 0.3 * (image_id % 3)]), np.zeros(3))
        local = points @ viewmat[:3, :3].T + viewmat[:3, 3]
        pixels = true_lens(image_id).img_from_cam(local) + rng.normal(0.0, noise, (len(points), 2))
        inside = ((pixels > 0) & (pixels < (640, 480))).all(axis=1)
        image = pycolmap.Image(name=f"00000/{image_id:06d}.jpg", camera_id=1, image_id=image_id)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(at) for at in pixels[inside]])
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(np.ascontiguousarray(viewmat[:3, :3])), viewmat[:3, 3])
        model.add_image_with_trivial_frame(image, pose)
        for row, index in enumerate(np.flatnonzero(inside)):
            seen[int(index)].append((image_id, row))
    for index, elements in seen.items():
        if len(elements) >= 2:
            track = pycolmap.Track()
            for image_id, row in elements:
                track.add_element(image_id, row)
            model.add_point3D(points[index], track, np.zeros(3, np.uint8))
    model.update_point_3d_errors()
    return model


def finding(true_lens: LensOf) -> CameraHealth:
    model = model_of(true_lens)
    figures = measure_model(model, None, should_stop=never_stop)
    error = model.compute_mean_reprojection_error()
    return judge(Evidence(n_photos=8, n_placed=8, error=error, **figures))  # type: ignore[arg-type]


def test_photos_that_agree_with_their_cameras_give_no_alarm() -> None:
    found = finding(lambda _: SHARED)
    assert (found.colour, found.cause) == ("green", "")


@pytest.mark.parametrize(
    ("cause", "true_lens"),
    [
        ("stretched", lambda _: lens("PINHOLE", 620.0, 500.0, 320.0, 240.0)),
        ("stretched", lambda i: lens("PINHOLE", 620.0 if i % 2 else 500.0, 500.0, 320.0, 240.0)),
        ("cropped", lambda i: lens("SIMPLE_PINHOLE", 500.0, 320.0 + 90.0 * (-1) ** i, 240.0 + 60.0 * (i % 3 - 1))),
        ("several_lenses", lambda i: lens("SIMPLE_PINHOLE", 500.0 if i % 2 else 800.0, 320.0, 240.0)),
    ],
)
def test_pictures_that_the_lens_cannot_have_made_are_named(cause: str, true_lens: LensOf) -> None:
    found = finding(true_lens)
    assert (found.colour, found.cause) == ("red", cause)
    assert found.sentence.endswith(".") and found.sentence.count(". ") == 0


def test_focal_lengths_of_zoomed_photos_are_found_from_a_model_with_one_lens() -> None:
    model = model_of(lambda i: lens("SIMPLE_PINHOLE", 900.0 if i in (2, 5) else 500.0, 320.0, 240.0))
    own = tried_lenses(model, should_stop=never_stop)
    assert lenses_differ(model, own)
    groups = group_by_focal(own.lenses, dict.fromkeys(range(1, 9), 0))
    assert [sorted(ids) for _, ids in groups] == [[1, 3, 4, 6, 7, 8], [2, 5]]
    # The gauge leaves the scale free, not the ratio of the lenses; noise of 0.2 px changes it by less than 3 %.
    assert groups[1][0].mean_focal_length() / groups[0][0].mean_focal_length() == pytest.approx(1.8, rel=0.03)


def test_photos_of_one_lens_are_not_given_several() -> None:
    model = model_of(lambda _: SHARED)
    assert not lenses_differ(model, tried_lenses(model, should_stop=never_stop))


@pytest.mark.parametrize("error", [DiskError, CameraError])
def test_trial_whose_model_cannot_be_written_is_made_in_this_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, error: type[Exception]
) -> None:
    def refused(folder: Path) -> None:
        raise error("The disk is nearly full.")

    model = model_of(lambda _: SHARED)
    with monkeypatch.context() as changed:
        changed.setattr("engine.cameras.lens_trials.require_free_space", refused)
        found = tried_apart(model, "own", tmp_path, should_stop=never_stop)
    assert caplog.messages == ["The disk is nearly full. It is made in this process."]
    assert found.error == tried_lenses(model, should_stop=never_stop).error
    missing = tried_apart(model, "own", tmp_path / "missing" / "folder", should_stop=never_stop)
    assert missing.error == found.error and list(tmp_path.iterdir()) == []


def test_matches_lie_on_their_epipolar_lines_only_where_the_poses_are_right() -> None:
    model = model_of(lambda _: SHARED, noise=0.0)
    common = [
        [(e.image_id, e.point2D_idx) for e in point.track.elements if e.image_id in (1, 2)]
        for point in model.points3D.values()
    ]
    rows = {image_id: [dict(one)[image_id] for one in common if len(one) == 2] for image_id in (1, 2)}
    at = {i: np.array([model.image(i).points2D[row].xy for row in rows[i]]) for i in (1, 2)}
    assert epipolar_distances(model, 1, 2, at[1], at[2]).max() < 1e-6
    assert np.median(epipolar_distances(model, 1, 5, at[1], at[2])) > 4.0


def test_two_exchanged_files_are_told_from_their_neighbours() -> None:
    # Photos 3 and 9 stand at each other's place: every pair with one of them disagrees, all others agree.
    pairs = [PairFit(a, b, 0.05 if {a, b} & {3, 9} else 0.95) for a in range(12) for b in (a + 1, a + 2) if b < 12]
    assert refuted_images(pairs) == [3, 9]


def test_two_exchanged_neighbours_that_agree_with_each_other_are_told_where_cameras_are_exact() -> None:
    # Neighbours that look sideways share their epipolar lines when exchanged; others lie a few pixels off.
    def fit(a: int, b: int) -> PairFit:
        wrong = len({a, b} & {4, 5}) == 1
        return PairFit(a, b, 0.6 if wrong else 0.95, 3.4 if wrong else 0.3)

    pairs = [fit(a, b) for a in range(12) for b in (a + 1, a + 2) if b < 12]
    assert refuted_images(pairs) == []
    assert refuted_images(pairs, exact=True) == [4, 5]


def test_cameras_that_are_all_less_exact_are_not_refuted() -> None:
    pairs = [PairFit(a, b, 0.9, 0.8 + 0.1 * (a % 3)) for a in range(12) for b in (a + 1, a + 2) if b < 12]
    assert refuted_images(pairs, exact=True) == []


def test_one_bad_pair_refutes_no_photo() -> None:
    pairs = [PairFit(a, a + 1, 0.1 if a == 4 else 0.9) for a in range(10)]
    assert refuted_images(pairs) == []


def test_only_the_strongest_partners_of_a_photo_count() -> None:
    pairs = [(0, other, 100 - other) for other in range(1, 8)] + [(5, 6, 29)]
    chosen = strongest_pairs(pairs)
    assert (5, 6, 29) not in chosen
    assert {(0, other, 100 - other) for other in range(1, 5)} <= set(chosen)


@pytest.mark.parametrize("focal", [300.0, 500.0, 1500.0])
def test_a_turn_on_one_place_is_told_from_a_flat_scene(focal: float) -> None:
    lens = pycolmap.Camera(model="SIMPLE_PINHOLE", width=640, height=480, params=[focal, 320.0, 240.0])
    K = lens.calibration_matrix()
    turn = (
        looking_at(np.zeros(3), np.array([1.0, 0.2, -0.1]))[:3, :3]
        @ looking_at(np.zeros(3), np.array([1.0, -0.1, 0.0]))[:3, :3].T
    )
    assert is_turn(K @ turn @ np.linalg.inv(K), lens, lens)
    # The plane z = 3 of the first camera, seen from another place.
    step = np.outer((1.0, 0.2, 0.1), (0.0, 0.0, 1.0)) / 3.0
    assert not is_turn(K @ (turn + step) @ np.linalg.inv(K), lens, lens)


def test_parts_that_were_laid_on_each_other_are_seen_by_what_is_missing() -> None:
    whole = model_of(lambda _: SHARED, noise=0.0, step=0.12)
    assert missing_share(whole) == 0.0
    # Every second photo is of a copy of the place, in which only an eighth of the things are the same.
    folded = without_common_points(whole)
    assert missing_share(folded) > 0.2


def test_zoomed_photos_need_not_show_what_their_neighbours_show() -> None:
    # The zoomed photos see the same points at twice the size, and features of that size are other ones.
    zoomed = model_of(lambda i: lens("SIMPLE_PINHOLE", 250.0 if i % 2 else 500.0, 320.0, 240.0), noise=0.0, step=0.12)
    assert missing_share(with_lens_of_odd_photos(without_common_points(zoomed), 250.0)) == 0.0
    assert missing_share(without_common_points(zoomed)) > 0.2


def without_common_points(whole: pycolmap.Reconstruction) -> pycolmap.Reconstruction:
    """Return a copy in which odd and even photos have only an eighth of their points in common."""
    model = pycolmap.Reconstruction(whole)
    for number, point_id in enumerate(sorted(whole.points3D)):
        if number % 8 == 0:
            continue
        for element in whole.point3D(point_id).track.elements:
            if element.image_id % 2 == number % 2 and model.exists_point3D(point_id):
                model.delete_observation(element.image_id, element.point2D_idx)
    return model


def with_lens_of_odd_photos(model: pycolmap.Reconstruction, focal: float) -> pycolmap.Reconstruction:
    """Return a copy whose odd photos have a lens of another focal length."""
    changed = pycolmap.Reconstruction()
    for image_id in sorted(model.reg_image_ids()):
        image = model.image(image_id)
        own = copy.deepcopy(model.camera(image.camera_id))
        own.camera_id = image_id
        if image_id % 2:
            own.params = [focal, *own.params[1:]]
        changed.add_camera_with_trivial_rig(own)
        copied = pycolmap.Image(name=image.name, camera_id=image_id, image_id=image_id)
        copied.points2D = pycolmap.Point2DList([pycolmap.Point2D(point.xy) for point in image.points2D])
        changed.add_image_with_trivial_frame(copied, image.cam_from_world())
    for point in model.points3D.values():
        changed.add_point3D(point.xyz, point.track, point.color)
    return changed


def test_other_lenses_are_tried_though_the_trial_of_all_together_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(model: pycolmap.Reconstruction, *arguments: Any, **options: Any) -> LensTrial:
        if arguments and options.get("principal_point"):
            return LensTrial(1.0, float("inf"), {})
        return tried_lenses(model, *arguments, **options)

    monkeypatch.setattr("engine.cameras.lens_trials.tried_lenses", failing)
    assert finding(lambda _: lens("PINHOLE", 620.0, 500.0, 320.0, 240.0)).cause == "stretched"


def test_matches_of_mirror_images_count_where_one_geometry_explains_them() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.0, 1.0, (40, 3)) + (0.0, 0.0, 4.0)
    at_first = 500.0 * points[:, :2] / points[:, 2:] + (320.0, 240.0)
    moved = points + (0.6, 0.1, 0.2)
    at_second = 500.0 * moved[:, :2] / moved[:, 2:] + (320.0, 240.0)
    mirrored = np.stack([640.0 - at_second[:, 0], at_second[:, 1]], axis=1)
    assert agreeing_as_mirrored(at_first, mirrored) == 40
    # Fourteen matches by chance: eight fit any geometry, and a few more.
    assert agreeing_as_mirrored(at_first[:14], rng.permutation(mirrored[:14])) < 13


def test_weak_mirrored_links_of_a_symmetric_building_do_not_count_against_strong_plain_ones() -> None:
    plain = [(200, i, i + 1, False) for i in range(5)]
    assert smaller_side(6, [*plain, (40, 0, 2, True)]) == []
    assert smaller_side(6, [(200, 0, 1, False), (200, 1, 2, True), (150, 2, 3, True), (90, 3, 4, False)]) == [2]


@pytest.mark.parametrize(
    ("cause", "colour", "change"),
    [
        ("panorama", "red", {"panorama_gain": 1.5}),
        ("fisheye", "red", {"fisheye_gain": 0.4}),
        ("repeated", "red", {"pairs": tuple(PairFit(i, i + 1, 0.1 if i % 3 == 0 else 0.9) for i in range(12))}),
        ("repeated", "red", {"missing": 0.2}),
        ("one_place", "red", {"turned": 0.95}),
        (
            "several_scenes",
            "yellow",
            {"other_models": (("a.jpg", "b.jpg", "c.jpg", "d.jpg", "e.jpg"),), "n_placed": 11},
        ),
        ("few_placed", "yellow", {"other_models": (("a.jpg",) * 5,), "n_placed": 8, "links": 3}),
        ("several_lenses", "yellow", {"n_placed": 8, "n_lenses": 2, "n_groups": 1}),
        (
            "several_lenses",
            "red",
            {"lenses_differ": True, "own_gain": 0.5, "error": 0.7, "aspect": 0.2, "aspect_gain": 0.88},
        ),
        ("stretched", "red", {"lenses_differ": True, "own_gain": 0.8, "error": 0.7, "aspect": 0.2, "aspect_gain": 0.6}),
        ("stretched", "red", {"aspect": 0.12, "aspect_gain": 0.93, "common_aspect": 0.1}),
        # A bent model of equal walls fits a little better when it is stretched, but lacks what stands around them.
        ("repeated", "red", {"aspect": 0.113, "aspect_gain": 0.947, "common_aspect": 0.111, "missing": 0.25}),
        # Sizes of features show zooms before any model: then other freedoms of the lens explain nothing.
        ("several_lenses", "red", {"size_gap": 1.5, "aspect": 0.04, "aspect_gain": 0.87, "shift_gain": 0.9}),
        ("several_lenses", "yellow", {"size_gap": 1.7, "n_placed": 14}),
        (
            "several_lenses",
            "yellow",
            {
                "size_gap": 1.4,
                "n_placed": 5,
                "n_lenses": 2,
                "n_groups": 1,
                "links": 1,
                "other_models": (("a.jpg", "b.jpg", "c.jpg", "d.jpg"),),
            },
        ),
        ("fisheye", "red", {"size_gap": 1.5, "fisheye_gain": 0.4}),
        ("one_place", "red", {"angle": 0.8}),
        ("few_placed", "yellow", {"n_placed": 7}),
        ("weak_tracks", "yellow", {"seen_by_three": 0.1}),
        ("unclear", "yellow", {"error": 0.8}),
        ("unclear", "red", {"error": 1.3}),
    ],
)
def test_each_finding_has_its_cause_and_one_sentence(cause: str, colour: str, change: dict[str, object]) -> None:
    sound = Evidence(n_photos=16, n_placed=16, error=0.3)
    assert judge(sound).colour == "green"
    found = judge(dataclasses.replace(sound, **change))  # type: ignore[arg-type]
    assert (found.colour, found.cause) == (colour, cause)
    assert found.sentence.endswith(".") and found.sentence.count(". ") == 0


def test_zoomed_photos_without_exif_get_their_own_lens(tmp_path: Path) -> None:
    cameras = room_cameras(9)
    make_scene(tmp_path / "photos", cameras)
    for index in (1, 3, 6, 8):
        file = tmp_path / "photos" / cameras[index].photo
        picture = Image.open(file)
        picture.resize((400, 300), Image.Resampling.LANCZOS, box=(75, 56.25, 325, 243.75)).save(file)
    found = estimate_cameras(read_photos(tmp_path / "photos"), tmp_path / "sfm", QUICK)
    focal = {camera.photo: camera.params[0] for camera in found.cameras}
    zoomed = [focal[cameras[i].photo] for i in (1, 3, 6, 8) if cameras[i].photo in focal]
    others = [focal[cameras[i].photo] for i in (0, 2, 4, 5, 7) if cameras[i].photo in focal]
    assert len(zoomed) >= 3 and len(others) >= 4
    assert zoomed == pytest.approx([380.0 * 1.6] * len(zoomed), rel=0.05)
    assert others == pytest.approx([380.0] * len(others), rel=0.05)
    assert found.health is not None and found.health.colour == "green"
    # The sizes of features alone showed it: the database has the photos in the order of their names.
    scales = relative_scales(tmp_path / "sfm" / "database.db")
    assert min(scales[i + 1] for i in (1, 3, 6, 8)) > max(scales[i + 1] for i in (0, 2, 4, 5, 7)) + 0.3
    assert size_gap(tmp_path / "sfm" / "database.db") > SIZES_DIFFER


def test_photos_of_one_lens_from_near_and_far_give_no_alarm(tmp_path: Path) -> None:
    target = np.array([1.4, 1.4, 0.5])
    cameras = tuple(
        dataclasses.replace(one, viewmat=looking_at(target + 0.6 * (one.center - target), target)) if i % 2 else one
        for i, one in enumerate(room_cameras(9))
    )
    found = estimate_cameras(make_scene(tmp_path / "photos", cameras).photo_set, tmp_path / "sfm", QUICK)
    # Sizes of features alone look like zooms.
    assert size_gap(tmp_path / "sfm" / "database.db") > SIZES_DIFFER
    assert found.health is not None and found.health.colour == "green"
    assert [camera.params[0] for camera in found.cameras] == pytest.approx([380.0] * 9, rel=0.03)


def test_photos_whose_focal_length_is_badly_known_stay_with_those_that_show_things_in_their_size(
    tmp_path: Path,
) -> None:
    boxes(84, change=zoomed(1.0, 1.0, 2.0))(tmp_path / "photos")
    settings = CameraSettings(max_side=800, max_features=800, first_octave=0)
    found = estimate_cameras(read_photos(tmp_path / "photos"), tmp_path / "sfm", settings)
    # Grouped by the focal lengths found alone, two photos had lenses of their own, and positions were wrong by 8 %.
    focals = sorted({camera.params[0] for camera in found.cameras})
    # Their common scale is weak: another rounding of the first focal lengths, by 1e-8, changes it by 2 %.
    assert focals == pytest.approx([420.0, 840.0], rel=0.04)
    assert focals[1] / focals[0] == pytest.approx(2.0, rel=0.02)


def test_mirrored_photos_are_named_and_not_placed(room: Scene, tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    mirrored = ("02.png", "05.png")
    for camera in room.cameras:
        picture = Image.open(room.photo_set.folder / camera.photo)
        (ImageOps.mirror(picture) if camera.photo in mirrored else picture).save(tmp_path / "photos" / camera.photo)
    events: list[Event] = []
    found = estimate_cameras(read_photos(tmp_path / "photos"), tmp_path / "sfm", QUICK, emit=events.append)
    assert found.health is not None and found.health.cause == "mirrored"
    assert not {camera.photo for camera in found.cameras} & set(mirrored)
    assert set(mirrored) <= set(found.unregistered)
    said = [event.message for event in events if isinstance(event, Warned)]
    assert any("mirror images" in message and "02.png" in message and "05.png" in message for message in said)
    assert [event for event in events if isinstance(event, Progress)][-1].message == "6 of 8 photos placed"


def test_given_cameras_with_a_wrong_focal_length_are_named(room: Scene) -> None:
    longer = tuple(
        dataclasses.replace(camera, params=(2.5 * camera.params[0], *camera.params[1:])) for camera in room.cameras
    )
    found = check_given_cameras(dataclasses.replace(as_given(room), cameras=longer), room.photo_set)
    assert found.health is not None and (found.health.colour, found.health.cause) == ("red", "given_cameras")
    assert "focal lengths" in found.health.sentence


def as_given(room: Scene) -> CameraSet:
    no_points = np.zeros((0, 3))
    return CameraSet(
        room.cameras, (), no_points.astype(np.float32), no_points.astype(np.uint8), 0.3, np.eye(4), poses_given=True
    )


def test_given_cameras_that_fit_their_photos_stay(room: Scene) -> None:
    found = check_given_cameras(as_given(room), room.photo_set)
    assert found.health is not None and found.health.colour == "green"
    assert found.cameras == room.cameras


def test_given_cameras_of_two_exchanged_photos_are_left_out(room: Scene) -> None:
    given = as_given(room)
    by_photo = dict(given.by_photo)
    by_photo["01.png"], by_photo["06.png"] = (
        dataclasses.replace(by_photo["06.png"], photo="01.png"),
        dataclasses.replace(by_photo["01.png"], photo="06.png"),
    )
    events: list[Event] = []
    exchanged = dataclasses.replace(given, cameras=tuple(by_photo[name] for name in sorted(by_photo)))
    found = check_given_cameras(exchanged, room.photo_set, emit=events.append)
    assert found.health is not None and found.health.colour == "red"
    assert found.unregistered == found.health.refuted == ("01.png", "06.png")
    assert any(isinstance(event, Warned) and "01.png, 06.png" in event.message for event in events)


def test_given_cameras_of_two_exchanged_neighbours_are_left_out(room: Scene) -> None:
    names = ("03.png", "04.png")
    by_photo = dict(as_given(room).by_photo)
    exchanged = {
        name: dataclasses.replace(by_photo[other], photo=name) for name, other in zip(names, names[::-1], strict=True)
    }
    cameras = tuple({**by_photo, **exchanged}[name] for name in sorted(by_photo))
    found = check_given_cameras(dataclasses.replace(as_given(room), cameras=cameras), room.photo_set)
    assert found.health is not None and found.health.refuted == names
