"""`export` and `render`: files are never replaced unasked nor half-written, and broken scenes are named."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from engine.formats.glb import read_glb
from engine.formats.ply import read_ply, read_ply_file
from engine.formats.sog import read_sog
from engine.formats.spz import read_spz
from engine.pictures import decode_picture
from engine.project.folder import ProjectFolder
from engine.project.objects import ObjectRecord, save_object
from engine.scene import (
    MeasuredDistance,
    Measurement,
    bottom_middle,
    read_camera_set,
    save_measurement,
    write_camera_set,
)
from engine.scene.detailed import Detailed
from engine.training import save_gaussians
from tests.conftest import ROOT
from tests.engine.command_line import Answer, call
from tests.engine.museum import write_point_cloud
from tests.engine.pictures.blob_scene import BLUE, BlobScene


def write(capsys: pytest.CaptureFixture[str], kind: str, scene: Path, out: Path, *more: str) -> Answer:
    """Write the scene as a PLY or glTF file, or a picture of it."""
    if kind == "png":
        return call(capsys, "render", scene, "--view", "view_1.png", "--out", out, *more)
    return call(capsys, "export", scene, "--format", kind, "--out", out, *more)


@pytest.mark.parametrize("kind", ["ply", "glb", "png"])
def test_existing_file_is_replaced_only_when_asked_and_never_halved(
    kind: str, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / f"out.{kind}"
    out.write_text("precious")
    assert "already exists" in write(capsys, kind, scene, out).error

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        assert "No space left on device" in write(capsys, kind, scene, out, "--overwrite").error
    assert out.read_text() == "precious"
    assert write(capsys, kind, scene, out, "--overwrite").code == 0
    assert out.stat().st_size > 1000
    assert sorted(path.name for path in tmp_path.iterdir()) == [out.name, "photos", "project"]


@pytest.mark.parametrize("kind", ["ply", "glb", "spz", "sog"])
def test_gaussians_alone_are_written_without_waiting_for_pytorch(kind: str, scene: Path, tmp_path: Path) -> None:
    """The viewer of the page waits for such a file."""
    code = (
        "import sys; from engine.cli.main import main; assert main(sys.argv[1:]) == 0; "
        "assert not {'torch', 'numba'} & set(sys.modules)"
    )
    words = ["export", str(scene), f"--format={kind}", f"--out={tmp_path / f'out.{kind}'}", "--record=none"]
    subprocess.run([sys.executable, "-c", code, *words], check=True, cwd=ROOT)


@pytest.mark.parametrize("kind", ["ply", "glb", "png"])
def test_folder_in_the_place_of_a_file_is_said(
    kind: str, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "is a folder" in write(capsys, kind, scene, tmp_path, "--overwrite").error


@pytest.mark.parametrize(("kind", "name"), [("ply", "out.glb"), ("glb", "out.ply"), ("png", "out.jpg")])
def test_name_that_promises_another_format_is_refused(
    kind: str, name: str, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = write(capsys, kind, scene, tmp_path / name)
    assert answer.code == 2
    assert "another extension" in answer.error


def test_both_formats_hold_the_whole_scene(
    scene: Path, blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for kind, read in (("ply", read_ply), ("glb", read_glb)):
        out = tmp_path / "new folder" / f"Büste 1.{kind}"
        assert write(capsys, kind, scene, out).code == 0
        assert np.allclose(read(out).means, blobs.gaussians.means, atol=1e-5)


def with_background(scene: Path, count: object) -> None:
    with ProjectFolder.create(scene) as project:
        project.finish_stage("training", "key", wall_seconds=1, cpu_seconds=1, figures={"n_background": count})


@pytest.mark.parametrize(("kind", "read"), [("ply", read_ply), ("glb", read_glb)])
def test_the_background_is_left_out_on_request_and_the_file_says_so(
    kind: str, read: Any, scene: Path, blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_background(scene, 7)
    whole, without = tmp_path / f"whole.{kind}", tmp_path / f"without.{kind}"
    assert write(capsys, kind, scene, whole).code == 0
    assert write(capsys, kind, scene, without, "--without-background").code == 0
    assert np.array_equal(read(without).means, read(whole).means[7:])
    left_out = b"background_left_out"
    assert left_out in without.read_bytes() and left_out not in whole.read_bytes()


@pytest.mark.parametrize("count", [-1, 10**6, "7", 1.5, True])
def test_a_background_that_cannot_be_is_refused(
    count: object, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_background(scene, count)
    answer = write(capsys, "ply", scene, tmp_path / "a.ply", "--without-background")
    assert "Gaussians are background" in answer.error and not (tmp_path / "a.ply").exists()


def test_a_scene_of_nothing_but_background_and_an_object_have_nothing_to_leave_out(
    scene: Path, blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_background(scene, len(blobs.gaussians))
    answer = write(capsys, "ply", scene, tmp_path / "a.ply", "--without-background")
    assert "nothing but background" in answer.error
    answer = write(capsys, "ply", scene, tmp_path / "a.ply", "--without-background", "--object", "x")
    assert "an object has no background" in answer.error


@pytest.mark.parametrize("kind", ["ply", "glb", "png"])
def test_scene_file_that_is_an_ordinary_point_cloud_is_refused(
    kind: str, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_point_cloud(scene / "gaussians" / "scene.ply", np.eye(3))
    error = write(capsys, kind, scene, tmp_path / f"out.{kind}").error
    assert "scene.ply" in error and "ordinary point cloud" in error
    assert not (tmp_path / f"out.{kind}").exists()


def test_unknown_object_and_photo_name_those_there_are(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "no objects yet" in write(capsys, "ply", scene, tmp_path / "out.ply", "--object", "vase").error
    answer = call(capsys, "render", scene, "--view", "view_99.png", "--out", tmp_path / "out.png")
    assert "view_99.png" in answer.error and "view_0.png" in answer.error


def test_object_leaves_detailed_in_files_and_in_its_picture(
    blobs: BlobScene, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = np.flatnonzero(blobs.part == BLUE).astype(np.int32)
    trained = blobs.gaussians[rows]
    green = np.zeros_like(trained.sh)
    green[:, 0, 1] = 2.0
    detailed = Detailed(rows, trained.means, rows, replace(trained, sh=green, features=None))
    record = ObjectRecord("ball", "Ball", {"kind": "click"}, 0.5, 1.0, 1.0, len(rows), len(blobs.part))
    save_object(scene, record, (blobs.part == BLUE).astype(np.float32), detailed=detailed)
    for kind, read in (("ply", read_ply), ("glb", read_glb)):
        out = tmp_path / f"ball.{kind}"
        assert write(capsys, kind, scene, out, "--object", "ball").code == 0
        np.testing.assert_allclose(read(out).sh, green, atol=1e-5)
    assert write(capsys, "png", scene, tmp_path / "ball.png", "--object", "ball").code == 0
    with Image.open(tmp_path / "ball.png") as picture:
        pixels = np.asarray(picture, np.int32)
    assert (pixels[..., 1] - pixels[..., 2]).max() > 80, "the trained ball is blue"


@pytest.mark.parametrize(("kind", "read"), [("ply", read_ply), ("glb", read_glb)])
def test_measured_scene_is_written_in_metres_and_an_unmeasured_one_says_that_its_unit_is_unknown(
    kind: str, read: Any, scene: Path, blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before, after = tmp_path / f"before.{kind}", tmp_path / f"after.{kind}"
    answer = write(capsys, kind, scene, before)
    assert "unit is unknown" in answer.of_kind("finished")[0]["message"]
    assert b"unknown" in before.read_bytes()
    save_measurement(scene, Measurement((MeasuredDistance((0, 0, 0), (1, 0, 0), 2.5),), origin=(0.0, 0.0, 1.0)))
    answer = write(capsys, kind, scene, after)
    assert "unit is the metre" in answer.of_kind("finished")[0]["message"]
    assert b"unknown" not in after.read_bytes() and b"measured" in after.read_bytes()
    expected = (blobs.gaussians.means - (0.0, 0.0, 1.0)) * 2.5
    np.testing.assert_allclose(read(after).means, expected, atol=1e-4)
    np.testing.assert_allclose(read(after).scales, blobs.gaussians.scales * 2.5, rtol=1e-4)


def with_points(scene: Path) -> None:
    """Give the cameras sparse points in the unit cube, as photos of the blobs would."""
    camera_set = read_camera_set(scene / "cameras")
    points = np.random.default_rng(0).uniform(-1, 1, (300, 3)).astype(np.float32)
    write_camera_set(
        scene / "cameras", replace(camera_set, points=points, point_colors=np.zeros(points.shape, np.uint8))
    )


def test_far_gaussians_are_left_out_kept_or_written_to_a_second_file(
    scene: Path, blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with_points(scene)
    moved = replace(blobs.gaussians, means=blobs.gaussians.means.copy())
    moved.means[5] = (500, 0, 0)
    save_gaussians(scene / "gaussians", moved)
    n = len(moved)
    left, kept, near = tmp_path / "left.ply", tmp_path / "kept.ply", tmp_path / "near.ply"
    answer = write(capsys, "ply", scene, left)
    assert "1 far Gaussians were left out" in answer.of_kind("finished")[0]["message"]
    assert len(read_ply(left)) == n - 1 and b"far_left_out 1" in left.read_bytes()
    assert write(capsys, "ply", scene, kept, "--far", "keep").code == 0 and len(read_ply(kept)) == n
    (tmp_path / "near_far.ply").write_text("precious")
    assert "near_far.ply already exists" in write(capsys, "ply", scene, near, "--far", "second-file").error
    assert write(capsys, "ply", scene, near, "--far", "second-file", "--overwrite").code == 0
    assert len(read_ply(near)) == n - 1
    np.testing.assert_allclose(read_ply(tmp_path / "near_far.ply").means, [[500, 0, 0]])


def test_viewers_find_a_ply_upright_and_the_frame_of_the_cameras_is_kept_on_request(
    scene: Path, blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    means = blobs.gaussians.means
    for frame, expected in (("upright", means[:, [0, 2, 1]] * (1, -1, 1)), ("world", means)):
        assert write(capsys, "ply", scene, tmp_path / f"{frame}.ply", "--frame", frame).code == 0
        stored = read_ply_file(tmp_path / f"{frame}.ply")
        np.testing.assert_allclose(stored.gaussians.means, expected, atol=1e-6)
        assert np.array_equal(np.round(stored.extra["photos_seen"]), stored.extra["photos_seen"])
        assert stored.extra["photos_seen"].max() > 0


def test_an_object_stands_on_the_origin_of_its_file_unless_it_shall_stay_in_the_scene(
    blobs: BlobScene, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    members = blobs.part == BLUE
    record = ObjectRecord("ball", "Ball", {"kind": "click"}, 0.5, 1.0, 1.0, int(members.sum()), len(members))
    save_object(scene, record, members.astype(np.float32))
    own, stays = tmp_path / "own.ply", tmp_path / "stays.ply"
    assert write(capsys, "ply", scene, own, "--object", "ball").code == 0
    assert write(capsys, "ply", scene, stays, "--object", "ball", "--origin", "scene").code == 0
    foot = bottom_middle(blobs.gaussians.means[members])
    np.testing.assert_allclose(read_ply(stays).means, blobs.gaussians.means[members], atol=1e-6)
    np.testing.assert_allclose(read_ply(own).means, blobs.gaussians.means[members] - foot, atol=1e-5)
    assert b"origin_in_scene " in own.read_bytes() and b"origin_in_scene" not in stays.read_bytes()


def test_sog_holds_the_scene_and_its_record(
    scene: Path, blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert write(capsys, "sog", scene, tmp_path / "a.sog", "--frame", "world").code == 0
    with zipfile.ZipFile(tmp_path / "a.sog") as archive:
        extras = json.loads(archive.read("meta.json"))["extras"]
    assert extras["unit"].startswith("unknown")
    back = read_sog(tmp_path / "a.sog", decode_picture, up="z")
    np.testing.assert_allclose(back.means.mean(axis=0), blobs.gaussians.means.mean(axis=0), atol=1e-3)
    np.testing.assert_allclose(np.sort(back.opacities), np.sort(blobs.gaussians.opacities), atol=0.51 / 255)
    assert write(capsys, "sog", scene, tmp_path / "b.sog", "--record", "none").code == 0
    with zipfile.ZipFile(tmp_path / "b.sog") as archive:
        assert "extras" not in json.loads(archive.read("meta.json"))
    # Viewers expect that -Y is up.
    upright = read_sog(tmp_path / "b.sog", decode_picture)
    flipped = read_sog(tmp_path / "b.sog", decode_picture, up="z")
    np.testing.assert_allclose(flipped.means, upright.means[:, [0, 2, 1]] * (1, -1, 1), atol=1e-6)


def test_spz_and_usd_hold_the_scene_and_say_what_they_cannot(
    scene: Path, blobs: BlobScene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = write(capsys, "spz", scene, tmp_path / "a.spz")
    assert "SPZ has no place for text" in answer.of_kind("warning")[0]["message"]
    np.testing.assert_allclose(read_spz(tmp_path / "a.spz").means, blobs.gaussians.means, atol=1e-3)
    usd = pytest.importorskip("pxr.Usd", reason="usd-core is optional: requirements/formats.txt")
    assert write(capsys, "usd", scene, tmp_path / "a.usdc").code == 0
    stage = usd.Stage.Open(str(tmp_path / "a.usdc"))
    np.testing.assert_allclose(stage.GetDefaultPrim().GetAttribute("positions").Get(), blobs.gaussians.means, atol=1e-6)
    assert stage.GetRootLayer().customLayerData["unit"].startswith("unknown")
