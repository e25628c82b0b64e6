"""`export` of meshes: in all formats of meshes, at the place of the object's Gaussians, with its record and unit."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData

from engine.formats import FORMATS, Format, format_of
from engine.project.objects import ObjectRecord, save_object
from engine.scene import MeasuredDistance, Measurement, save_measurement
from tests.engine.command_line import Answer, call
from tests.engine.objects.fakes import trained_project
from tests.engine.pictures.blob_scene import BLUE, BlobScene

MESHES = [one for one in FORMATS if one.write_mesh is not None]


@pytest.fixture
def scene(blobs: BlobScene, tmp_path: Path) -> Path:
    path = trained_project(blobs, tmp_path).path
    members = (blobs.part == BLUE).astype(np.float32)
    record = ObjectRecord("ball", "Ball", {"kind": "click"}, 0.5, 1.0, 1.0, int(members.sum()), len(members))
    save_object(path, record, members)
    return path


def export(capsys: pytest.CaptureFixture[str], scene: Path, kind: str, out: Path, *more: str) -> Answer:
    return call(
        capsys, "export", scene, "--object", "ball", "--format", kind, "--out", out, "--triangles", "5000", *more
    )


def message_of(answer: Answer) -> str:
    """Return the sentence of a command that succeeded."""
    message: str = answer.of_kind("finished")[0]["message"]
    return message


@pytest.mark.parametrize("kind", MESHES, ids=lambda one: one.name)
def test_object_is_written_as_a_mesh_that_says_that_its_unit_is_unknown(
    kind: Format, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / f"ball{kind.suffixes[0]}"
    answer = export(capsys, scene, kind.name, out)
    assert answer.code == 0
    assert "its unit is unknown" in message_of(answer)
    assert "triangles, fused from" in message_of(answer)
    assert out.is_file()
    data = out.read_bytes() if out.suffix != ".usdz" else zipfile.ZipFile(out).read("mesh.usda")
    assert b"unknown" in data


@pytest.mark.parametrize("kind", ["glb-mesh", "obj", "usd-mesh"])
def test_textures_have_alpha_only_where_no_program_draws_it(
    kind: str, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Blender shows black where the alpha of an OBJ's or a USDZ's texture is 0."""
    out = tmp_path / f"ball{format_of(kind).suffixes[0]}"
    assert export(capsys, scene, kind, out).code == 0
    data = (out.with_suffix(".png") if kind == "obj" else out).read_bytes()
    picture = Image.open(io.BytesIO(data[data.index(b"\x89PNG") :]))
    assert picture.mode == ("RGBA" if kind == "glb-mesh" else "RGB")


def test_mesh_lies_where_the_gaussians_lie(
    blobs: BlobScene, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "ball.ply"
    assert export(capsys, scene, "mesh", out, "--frame", "world").code == 0
    vertices = PlyData.read(out)["vertex"]
    places = np.column_stack([vertices["x"], vertices["y"], vertices["z"]])
    middle = blobs.gaussians.means[blobs.part == BLUE].mean(axis=0)
    assert np.abs((places.min(axis=0) + places.max(axis=0)) / 2 - middle).max() < 0.1


def test_watertight_mesh_of_known_scale_says_its_volume(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_measurement(scene, Measurement((MeasuredDistance((0, 0, 0), (1, 0, 0), 0.1),)))
    out = tmp_path / "ball.glb"
    answer = export(capsys, scene, "glb-mesh", out, "--watertight")
    assert answer.code == 0
    assert "cm3" in message_of(answer)
    data = out.read_bytes()
    extras = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])["asset"]["extras"]
    assert "watertight" in extras["mesh"]
    assert "seen by no photo" in extras["mesh"]


def test_package_holds_the_mesh_that_was_asked_for_and_says_what_it_is(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(capsys, "package", scene, "--object", "ball", "--with-mesh", "--out", tmp_path / "kept").code == 0
    kept = tmp_path / "kept" / "ball"
    assert (kept / "data" / "ball_mesh.glb").read_bytes()[:4] == b"glTF"
    assert "ball_mesh.glb" in (kept / "data" / "README.txt").read_text(encoding="utf-8")
    assert "data/ball_mesh.glb" in (kept / "manifest-sha256.txt").read_text(encoding="utf-8")
    assert call(capsys, "verify", kept).code == 0


def test_package_of_a_scene_has_no_mesh(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = call(capsys, "package", scene, "--scene", "--with-mesh", "--out", tmp_path / "kept")
    assert answer.code != 0 and "Leave out --with-mesh" in answer.error
    assert not (tmp_path / "kept").exists()


def test_scene_is_refused_as_a_mesh(scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = call(capsys, "export", scene, "--format", "glb-mesh", "--out", tmp_path / "scene.glb")
    assert "Name one with --object" in answer.error


def test_settings_of_meshes_are_refused_for_gaussians(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = call(capsys, "export", scene, "--format", "ply", "--out", tmp_path / "a.ply", "--watertight")
    assert "are for meshes" in answer.error


def test_texture_that_exists_is_not_replaced_unasked(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "ball.png").write_text("precious")
    assert "ball.png already exists" in export(capsys, scene, "obj", tmp_path / "ball.obj").error
    assert (tmp_path / "ball.png").read_text(encoding="utf-8") == "precious"


def test_mesh_stands_where_another_program_places_it_and_faces_outward_when_mirrored(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert export(capsys, scene, "mesh", tmp_path / "world.ply", "--frame", "world", "--watertight").code == 0
    matrix = np.array([[-2.0, 0, 0, 5], [0, 0, -2e-5, -1], [0, 3, 0, 0], [0, 0, 0, 1]])
    numbers = "--placement=" + ",".join(map(repr, matrix.ravel().tolist()))
    answer = export(capsys, scene, "mesh", tmp_path / "placed.ply", numbers, "--unit", "metre", "--watertight")
    assert answer.code == 0
    assert "its unit is the metre" in message_of(answer)
    (expected, expected_volume), (placed, volume) = (
        _places_and_volume(tmp_path / f"{name}.ply") for name in ("world", "placed")
    )
    np.testing.assert_allclose(placed, expected @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-5)
    assert volume > 0
    np.testing.assert_allclose(volume, expected_volume * abs(np.linalg.det(matrix[:3, :3])), rtol=1e-3)


def _places_and_volume(file: Path) -> tuple[np.ndarray, float]:
    data = PlyData.read(file)
    places = np.column_stack([data["vertex"][axis].astype(np.float64) for axis in "xyz"])
    a, b, c = places[np.stack(data["face"]["vertex_indices"])].transpose(1, 0, 2)
    return places, float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["--placement=1,2,3"], "is not 16 numbers"),
        (["--placement=" + "0," * 15 + "1"], "places nothing"),
        (["--placement=1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1", "--frame", "world"], "Give only one"),
        (["--unit", "metre"], "--unit says what --placement places"),
    ],
)
def test_placement_that_cannot_be_is_refused_in_a_sentence(
    words: list[str], what: str, scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert what in export(capsys, scene, "mesh", tmp_path / "ball.ply", *words).error
