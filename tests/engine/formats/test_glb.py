"""GLB files are read as written, follow glTF and KHR_gaussian_splatting, and pass the Khronos validator."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.core.errors import FormatError, NumericalError
from engine.formats.axes import file_from_z_up
from engine.formats.facts import FileFacts
from engine.formats.glb import read_glb, write_glb
from engine.formats.spherical_harmonics import sh_basis

from .conftest import GlbErrors, RandomGaussians


def json_part(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    return json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("count", [1, 100])
def test_written_gaussians_are_read_back(
    tmp_path: Path, count: int, degree: int, random_gaussians: RandomGaussians
) -> None:
    gaussians = random_gaussians(count, degree=degree)
    write_glb(tmp_path / "object.glb", gaussians)
    back = read_glb(tmp_path / "object.glb")
    np.testing.assert_array_equal(back.means, gaussians.means)
    np.testing.assert_allclose(back.log_scales, gaussians.log_scales, atol=1e-6)
    np.testing.assert_allclose(back.sh, gaussians.sh, atol=1e-6)
    np.testing.assert_allclose(back.opacities, gaussians.opacities, atol=1e-7)
    unit = gaussians.quats / np.linalg.norm(gaussians.quats, axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs((back.quats * unit).sum(axis=1)), 1, atol=1e-6)


def test_up_is_up_in_gltf(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(3)
    gaussians.means[0] = (1, 2, 3)
    write_glb(tmp_path / "object.glb", gaussians)
    binary = tmp_path.joinpath("object.glb").read_bytes()
    start = 20 + struct.unpack_from("<I", binary, 12)[0] + 8
    assert np.frombuffer(binary, "<f4", 3, start).tolist() == [1, 3, -2]
    np.testing.assert_array_equal(file_from_z_up("y") @ file_from_z_up("-y"), np.eye(4))


def test_colour_from_a_rotated_direction_is_unchanged(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(4)
    path = tmp_path / "object.glb"
    write_glb(path, gaussians)
    document, data = json_part(path), path.read_bytes()
    start = 20 + struct.unpack_from("<I", data, 12)[0] + 8
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    names = [f"KHR_gaussian_splatting:SH_DEGREE_{band}_COEF_{i}" for band in range(4) for i in range(2 * band + 1)]
    offsets = [document["bufferViews"][attributes[name]]["byteOffset"] for name in names]
    sh = np.stack([np.frombuffer(data, "<f4", 12, start + offset).reshape(4, 3) for offset in offsets], axis=1)
    direction = np.array([[0.48, -0.6, 0.64]])
    seen = sh_basis(direction @ file_from_z_up("y")[:3, :3].T, 3) @ sh
    np.testing.assert_allclose(seen, sh_basis(direction, 3) @ gaussians.sh, atol=2e-6)


def test_json_part_follows_the_extension(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    path = tmp_path / "object.glb"
    gaussians = random_gaussians(7, degree=2)
    write_glb(
        path,
        gaussians,
        FileFacts("Vase", rights="CC BY 4.0, Museum of Ü", extras={"catalogueNumber": "1906.12"}),
    )
    document = json_part(path)
    assert document["asset"]["version"] == "2.0"
    assert document["asset"]["copyright"] == "CC BY 4.0, Museum of Ü"
    assert document["asset"]["extras"] == {"catalogueNumber": "1906.12"}
    assert document["extensionsUsed"] == ["KHR_gaussian_splatting"]
    primitive = document["meshes"][0]["primitives"][0]
    assert primitive["mode"] == 0
    extension = primitive["extensions"]["KHR_gaussian_splatting"]
    assert (extension["kernel"], extension["colorSpace"]) == ("ellipse", "srgb_rec709_display")
    prefix = "KHR_gaussian_splatting:"
    expected = {"POSITION", "COLOR_0", *(prefix + name for name in ("ROTATION", "SCALE", "OPACITY"))}
    expected |= {f"{prefix}SH_DEGREE_{band}_COEF_{i}" for band in range(3) for i in range(2 * band + 1)}
    assert set(primitive["attributes"]) == expected
    position = document["accessors"][primitive["attributes"]["POSITION"]]
    turned = gaussians.means @ file_from_z_up("y")[:3, :3].T.astype(np.float32)
    assert position["min"] == turned.min(axis=0).tolist() and position["max"] == turned.max(axis=0).tolist()
    for view in document["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
    assert path.stat().st_size % 4 == 0


def test_fallback_colour_is_linear(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(1, degree=0)
    gaussians.sh[:] = 0.0  # mid-grey in sRGB, 0.2140 linear
    path = tmp_path / "object.glb"
    write_glb(path, gaussians)
    document, data = json_part(path), path.read_bytes()
    view = document["bufferViews"][document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
    start = 20 + struct.unpack_from("<I", data, 12)[0] + 8 + view["byteOffset"]
    assert np.frombuffer(data, "<u2", 3, start).tolist() == [round(0.21404114 * 65535)] * 3


def test_empty_object_is_written_and_read(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    write_glb(tmp_path / "empty.glb", random_gaussians(0))
    assert len(read_glb(tmp_path / "empty.glb")) == 0


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"ply\nformat", "is not a glTF 2.0 binary"),
        (b"", "is not a readable GLB"),
        (struct.pack("<IIIII", 0x46546C67, 2, 24, 4, 0x4E4F534A) + b"{}  ", "cannot be read: `asset` is missing"),
        (struct.pack("<IIIII", 0x46546C67, 2, 99, 4, 0x4E4F534A) + b"{}  ", "is truncated"),
        (struct.pack("<IIIII", 0x46546C67, 2, 24, 4, 0x4E4F534A) + b"{]  ", "cannot be read"),
    ],
)
def test_other_files_are_refused_with_a_reason(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "file.glb"
    path.write_bytes(content + bytes(max(0, 12 - len(content)) if content else 0))
    with pytest.raises(FormatError, match=sentence):
        read_glb(path)


def test_a_missing_file_is_reported_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"nowhere\.glb cannot be read: .*Check the path"):
        read_glb(tmp_path / "nowhere.glb")


def test_values_that_are_not_finite_are_never_written(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(2)
    gaussians.means[0, 0] = np.nan
    with pytest.raises(NumericalError, match="`means`"):
        write_glb(tmp_path / "object.glb", gaussians)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("degree", [0, 3])
def test_khronos_validator_accepts_all_but_the_new_attribute_names(
    tmp_path: Path, glb_errors: GlbErrors, degree: int, random_gaussians: RandomGaussians
) -> None:
    path = tmp_path / "object.glb"
    write_glb(path, random_gaussians(100, degree=degree), FileFacts(extras={"title": "Vase"}, rights="CC0"))
    known = 4 + (degree + 1) ** 2 - 1
    errors = glb_errors(path)
    # The validator does not know the extension: it reports exactly one error per KHR attribute name.
    assert {error["code"] for error in errors} == {"MESH_PRIMITIVE_INVALID_ATTRIBUTE"}
    assert all("/attributes/KHR_gaussian_splatting:" in error["pointer"] for error in errors)
    assert len(errors) == known


def changed(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Change the JSON part of a file."""
    data, document = path.read_bytes(), json_part(path)
    length = struct.unpack_from("<I", data, 12)[0]
    change(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    path.write_bytes(
        struct.pack("<IIIII", 0x46546C67, 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest
    )


def set_to(place: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(document: dict[str, Any]) -> None:
        *parents, last = place.split("/")
        target: Any = document
        for name in parents:
            target = target[int(name)] if isinstance(target, list) else target[name]
        target[last] = value

    return change


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("accessors/0/count", 10**15),
        ("accessors/0/count", -1),
        ("accessors/0/count", 0),
        ("accessors/0/count", 6),
        ("accessors/1/count", 10**9),
        ("accessors/1/count", 1e400),
        ("accessors/1/byteOffset", -4),
        ("accessors/1/byteOffset", 10**18),
        ("accessors/1/bufferView", -1),
        ("accessors/1/bufferView", 999),
        ("accessors/1/type", "VEC3"),
        ("accessors/1/type", []),
        ("bufferViews/1/byteOffset", 10**30),
        ("bufferViews/1/byteOffset", -16),
        ("bufferViews/1/byteLength", 4),
        ("bufferViews/1/buffer", 1),
        ("meshes/0/primitives/0/attributes", {"POSITION": -1}),
        ("meshes/0/primitives/0/attributes", []),
        ("meshes/0/primitives/0/extensions", None),
        ("meshes/0/primitives", []),
        ("meshes", None),
        ("nodes", [7]),
        ("asset/generator", 5),
        ("buffers/0/uri", "data:application/octet-stream;base64,AAAA"),
        ("buffers/0/uri", "../../secret.bin"),
    ],
)
def test_a_part_that_contradicts_the_file_is_one_sentence(
    tmp_path: Path, place: str, value: Any, random_gaussians: RandomGaussians
) -> None:
    path = tmp_path / "object.glb"
    write_glb(path, random_gaussians(5, degree=1))
    changed(path, lambda document: None)
    assert len(read_glb(path)) == 5
    changed(path, set_to(place, value))
    with pytest.raises(FormatError, match=r"object\.glb"):
        read_glb(path)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30])
def test_values_that_cannot_be_used_are_refused(
    tmp_path: Path, value: float, random_gaussians: RandomGaussians
) -> None:
    path = tmp_path / "object.glb"
    write_glb(path, random_gaussians(5, degree=0))
    whole = path.read_bytes()
    color_size = 5 * 8  # the last attribute, as whole numbers
    for end in (len(whole) - color_size - 4, 20 + struct.unpack_from("<I", whole, 12)[0] + 8):
        path.write_bytes(whole[:end] + np.float32(value).tobytes() + whole[end + 4 :])
        with pytest.raises(FormatError, match="not finite or too large"):
            read_glb(path)


def test_a_cut_file_and_a_damaged_binary_part_are_one_sentence(
    tmp_path: Path, random_gaussians: RandomGaussians
) -> None:
    path = tmp_path / "object.glb"
    write_glb(path, random_gaussians(5, degree=0))
    whole = path.read_bytes()
    start = 20 + struct.unpack_from("<I", whole, 12)[0]
    hostile = [whole[:n] for n in (3, 12, 19, 20, start, start + 4, start + 8, len(whole) - 1)]
    hostile += [data[:8] + struct.pack("<I", len(data)) + data[12:] for data in hostile if len(data) >= 12]
    hostile += [whole[:12] + b"\xff\xff\xff\xff" + whole[16:], whole[:start] + b"\xff\xff\xff\xff" + whole[start + 4 :]]
    for data in hostile:
        path.write_bytes(data)
        with pytest.raises(FormatError, match=r"object\.glb"):
            read_glb(path)
