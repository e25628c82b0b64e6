"""Meshes in files, as other programs read them."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData

from engine.core.errors import FormatError, SettingsError
from engine.formats import FORMATS, FileFacts, write_mesh
from engine.pictures import encode_png
from engine.scene import Mesh

from .conftest import GlbErrors

MESHES = [one for one in FORMATS if one.write_mesh is not None]
SCALE = 3.0
"""Size of the test's cube in the units of the file."""


def cube() -> Mesh:
    """Return a cube of side 1 whose underside no photo saw, with a texture of 8 x 8 pixels."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (1, 5, 7, 3), (0, 2, 6, 4)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)
    seen = np.arange(12) < 10
    normals = (corners - 0.5) / np.linalg.norm(corners - 0.5, axis=1, keepdims=True)
    texture = np.zeros((8, 8, 4), np.uint8)
    texture[..., :3] = np.arange(8)[:, None, None] * 30
    texture[:4, :, 3] = 255
    uv = np.tile(np.array([[0.1, 0.2], [0.8, 0.2], [0.8, 0.9]], np.float32), (12, 1))
    return Mesh(
        corners, faces, seen, (255 * corners).astype(np.uint8), normals.astype(np.float32), faces.ravel(), uv,
        np.arange(36, dtype=np.int32).reshape(12, 3), texture,
    )  # fmt: skip


def facts(**changes: object) -> FileFacts:
    standard = FileFacts(
        name="Cube of the tests", matrix=np.diag([SCALE, SCALE, SCALE, 1.0]), metres_per_unit=0.5,
        extras={"mesh": "12 triangles", "title": 'Ä "cube"'}, comments=["title Ä cube"], rights="CC0",
    )  # fmt: skip
    return replace(standard, **changes)  # type: ignore[arg-type]


def written(tmp_path: Path, name: str, given: FileFacts | None = None) -> Path:
    path = tmp_path / f"cube{next(one.suffixes[0] for one in MESHES if one.name == name)}"
    mesh = cube()
    write_mesh(path, mesh, name, facts() if given is None else given, encode_png(mesh.texture))
    return path


def glb_parts(path: Path) -> tuple[dict, bytes]:
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def test_ply_has_colours_marks_and_the_record(tmp_path: Path) -> None:
    ply = PlyData.read(written(tmp_path, "mesh"))
    vertices = ply["vertex"]
    assert vertices["z"].max() == SCALE
    assert sorted(vertices["seen"].tolist()) == [0] * 4 + [1] * 4  # the four corners of the underside
    assert ply["face"]["seen"].sum() == 10
    assert any("title" in comment for comment in ply.comments)
    assert vertices["red"].max() == 255


def test_glb_stands_upright_and_has_two_materials_and_the_record(tmp_path: Path) -> None:
    document, binary = glb_parts(written(tmp_path, "glb-mesh"))
    primitives = document["meshes"][0]["primitives"]
    names = [document["materials"][one["material"]]["name"] for one in primitives]
    assert names == ["photographed", "filled_seen_by_no_photo"]
    position = document["accessors"][primitives[0]["attributes"]["POSITION"]]
    assert position["min"] == [0, 0, -SCALE]  # Z up becomes Y up
    assert position["max"] == [SCALE, SCALE, 0]
    assert document["asset"]["extras"]["mesh"] == "12 triangles"
    assert document["asset"]["copyright"] == "CC0"
    filled = document["accessors"][primitives[1]["indices"]]
    assert filled["count"] == 6
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    picture = Image.open(io.BytesIO(binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]))
    assert (np.asarray(picture) == cube().texture).all()
    for material in document["materials"]:
        assert material["pbrMetallicRoughness"]["metallicFactor"] == 0


@pytest.mark.slow
def test_khronos_validator_finds_no_error_in_a_mesh(tmp_path: Path, glb_errors: GlbErrors) -> None:
    assert glb_errors(written(tmp_path, "glb-mesh")) == []


def test_glb_of_a_mesh_that_photos_saw_has_one_material(tmp_path: Path) -> None:
    mesh, path = cube(), tmp_path / "cube.glb"
    seen = replace(mesh, seen=np.ones(12, bool))
    write_mesh(path, seen, "glb-mesh", facts(), encode_png(mesh.texture))
    document, _ = glb_parts(path)
    assert [one["name"] for one in document["materials"]] == ["photographed"]


def test_obj_refers_to_its_material_and_texture(tmp_path: Path) -> None:
    path = written(tmp_path, "obj")
    text = path.read_text(encoding="utf-8")
    assert "mtllib cube.mtl" in text
    assert "map_Kd cube.png" in (tmp_path / "cube.mtl").read_text(encoding="utf-8")
    assert (np.asarray(Image.open(tmp_path / "cube.png")) == cube().texture).all()
    groups = text.split("usemtl ")[1:]
    assert [group.split("\n", 1)[0] for group in groups] == ["photographed", "filled_seen_by_no_photo"]
    assert groups[1].count("\nf ") == 2
    heights = [float(line.split()[2]) for line in text.splitlines() if line.startswith("v ")]
    assert (min(heights), max(heights)) == (0, SCALE)


def test_obj_whose_name_has_a_space_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="space"):
        write_mesh(tmp_path / "a cube.obj", cube(), "obj", facts(), b"")


@pytest.mark.parametrize(("metres", "side"), [(0.5, 1500.0), (None, SCALE)])
def test_stl_is_in_millimetres_where_the_scale_is_known(tmp_path: Path, metres: float | None, side: float) -> None:
    data = written(tmp_path, "stl", facts(metres_per_unit=metres)).read_bytes()
    assert len(data) == 84 + 50 * 12
    assert (b"millimetre" if metres else b"unknown") in data[:80]
    assert b"2 of 12 filled" in data[:80]
    rows = np.frombuffer(data[84:], [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    assert rows["corners"].max() == side
    middle = rows["corners"].mean(axis=1) - side / 2
    assert (np.einsum("ij,ij->i", rows["normal"], middle) > 0).all()


@pytest.mark.parametrize("metres", [0.5, None])
def test_usdz_opens_with_openusd_with_unit_and_materials(tmp_path: Path, metres: float | None) -> None:
    path = written(tmp_path, "usd-mesh", facts(metres_per_unit=metres))
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            assert entry.compress_type == zipfile.ZIP_STORED
        text = archive.read("mesh.usda").decode()
    assert ('string unit = "unknown"' in text) == (metres is None)
    usd = pytest.importorskip("pxr.Usd")
    geometry, shading = pytest.importorskip("pxr.UsdGeom"), pytest.importorskip("pxr.UsdShade")
    stage = usd.Stage.Open(str(path))
    assert geometry.GetStageUpAxis(stage) == "Z"
    assert geometry.GetStageMetersPerUnit(stage) == (metres or 1.0)
    mesh = geometry.Mesh(stage.GetPrimAtPath("/Object/Mesh"))
    assert np.array(mesh.GetPointsAttr().Get()).max() == SCALE
    subsets = shading.MaterialBindingAPI(mesh).GetMaterialBindSubsets()
    assert [len(one.GetIndicesAttr().Get()) for one in subsets] == [10, 2]


def test_data_of_a_usdz_begins_at_multiples_of_64_bytes(tmp_path: Path) -> None:
    path = written(tmp_path, "usd-mesh")
    data = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            name, extra = struct.unpack_from("<HH", data, entry.header_offset + 26)
            assert (entry.header_offset + 30 + name + extra) % 64 == 0


@pytest.mark.parametrize("name", [one.name for one in MESHES])
def test_interrupted_writing_leaves_the_old_file(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, name)
    before = path.read_bytes()

    def fail(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(Exception, match="No space left"):
        write_mesh(path, replace(cube(), vertices=2 * cube().vertices), name, facts(), encode_png(cube().texture))
    assert path.read_bytes() == before
    assert not [one for one in tmp_path.iterdir() if one.name.startswith(".writing")]


def test_format_without_meshes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="glb-mesh"):
        write_mesh(tmp_path / "a.spz", cube(), "spz", facts(), b"")


def test_cube_is_closed_and_has_its_volume() -> None:
    assert cube().is_closed
    assert abs(cube().volume - 1) < 1e-6  # rounding
    assert not replace(cube(), faces=cube().faces[1:]).is_closed
