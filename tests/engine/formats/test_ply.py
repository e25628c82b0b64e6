"""PLY files are read as written, have the standard byte layout, and other files are refused with a sentence."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import FormatError, NumericalError
from engine.formats.ply import read_ply, write_ply
from engine.scene.gaussians import Gaussians

from .conftest import RandomGaussians


# Sizes around the chunk size are tested with one degree.
@pytest.mark.parametrize(("count", "degree"), [(1, 0), (1, 1), (1, 2), (1, 3), (4095, 1), (4096, 1), (4097, 1)])
def test_written_gaussians_are_read_back_bit_for_bit(
    tmp_path: Path,
    count: int,
    degree: int,
    random_gaussians: RandomGaussians,
    assert_same_gaussians: Callable[..., None],
) -> None:
    gaussians = random_gaussians(count, degree=degree)
    write_ply(tmp_path / "scene.ply", gaussians)
    assert_same_gaussians(read_ply(tmp_path / "scene.ply"), gaussians)


def test_no_gaussians_are_an_empty_list(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    write_ply(tmp_path / "none.ply", random_gaussians(0, degree=2), up="-y")
    content = (tmp_path / "none.ply").read_bytes()
    assert b"element vertex 0\n" in content and content.endswith(b"end_header\n")


def test_layout_is_the_standard_one(tmp_path: Path) -> None:
    # Each value encodes its position, so that exchanged channels or coefficients are detected.
    sh = np.array([[[100 * channel + k for channel in range(3)] for k in range(4)]], dtype=np.float32)
    one = Gaussians(
        means=np.array([[1, 2, 3]], np.float32),
        log_scales=np.array([[4, 5, 6]], np.float32),
        quats=np.array([[7, 8, 9, 10]], np.float32),
        opacity_logits=np.array([11], np.float32),
        sh=sh,
    )
    path = tmp_path / "one.ply"
    write_ply(path, one, comments=["CatalogueNumber\n1906.12"])
    header, body = path.read_bytes().split(b"end_header\n")
    names = [line.split()[2] for line in header.decode().splitlines() if line.startswith("property")]
    assert "comment CatalogueNumber 1906.12" in header.decode().splitlines()
    assert names == [
        *["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"],
        *(f"f_rest_{i}" for i in range(9)),
        *["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"],
    ]
    rest = [1, 2, 3, 101, 102, 103, 201, 202, 203]
    assert np.frombuffer(body, "<f4").tolist() == [
        1,
        2,
        3,
        0,
        0,
        0,
        0,
        100,
        200,
        *rest,
        11,
        4,
        5,
        6,
        7,
        8,
        9,
        10,
    ]


def test_a_title_in_any_script_leaves_a_header_that_other_programs_read(
    tmp_path: Path, random_gaussians: RandomGaussians
) -> None:
    titles = ["Ölkanne", "花瓶 🏺", 'a "vase"', "back\\slash"]
    write_ply(tmp_path / "a.ply", random_gaussians(3), comments=titles)
    header = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")[0].decode("ascii")
    written = [line.removeprefix("comment ") for line in header.splitlines() if line.startswith("comment ")]
    assert written[0] == r"\u00d6lkanne" and written[2] == 'a "vase"'
    assert [json.loads('"' + line.replace('"', r"\"") + '"') for line in written] == titles
    assert len(read_ply(tmp_path / "a.ply")) == 3


@pytest.mark.parametrize("order", ["<", ">"])
def test_other_property_orders_types_and_extras_are_read(
    tmp_path: Path, order: str, random_gaussians: RandomGaussians, assert_same_gaussians: Callable[..., None]
) -> None:
    gaussians = random_gaussians(17, degree=1)
    rest = gaussians.sh[:, 1:].transpose(0, 2, 1).reshape(17, 9)
    columns = {
        "rot_3": gaussians.quats[:, 3], "rot_0": gaussians.quats[:, 0], "rot_1": gaussians.quats[:, 1],
        "rot_2": gaussians.quats[:, 2], "object_id": np.arange(17), "opacity": gaussians.opacity_logits,
        **{f"f_rest_{i}": rest[:, i] for i in reversed(range(9))},
        **{f"f_dc_{i}": gaussians.sh[:, 0, i] for i in range(3)},
        **{f"scale_{i}": gaussians.log_scales[:, i] for i in range(3)},
        **{axis: gaussians.means[:, i] for i, axis in enumerate("xyz")},
    }  # fmt: skip
    kinds = {"object_id": ("uchar", "u1"), "x": ("double", "f8")}
    dtype = np.dtype([(name, order + kinds.get(name, ("float", "f4"))[1]) for name in columns])
    rows = np.zeros(17, dtype)
    for name, values in columns.items():
        rows[name] = values
    lines = [
        "ply",
        f"format binary_{'little' if order == '<' else 'big'}_endian 1.0",
        "comment made elsewhere",
    ]
    lines += ["element camera 2", "property float fov", "element vertex 17"]
    lines += [f"property {kinds.get(name, ('float', 'f4'))[0]} {name}" for name in columns]
    lines += ["element face 1", "property list uchar int vertex_indices", "end_header", ""]
    (tmp_path / "other.ply").write_bytes("\n".join(lines).encode() + bytes(8) + rows.tobytes() + bytes(13))
    assert_same_gaussians(read_ply(tmp_path / "other.ply"), gaussians)


CLOUD = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
    b"property float x\nproperty float y\nproperty float z\nend_header\n"
)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (CLOUD + bytes(12), "is not a Gaussian PLY: it has no f_dc_0.*ordinary point cloud or mesh"),
        (b"glTF whatever", "is not a PLY file"),
        (b"", "is not a PLY file"),
        (b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n", "is an ASCII PLY file"),
        (b"ply\nformat binary_little_endian 1.0\n\nelement vertex 1\n", "header does not end"),
        (b"ply\nelement vertex 1\nproperty float x\nend_header\n", "states no format"),
        (CLOUD.replace(b"vertex 1", b"vertex one"), "header line that cannot be read: `element vertex one`"),
        (CLOUD.replace(b"float x", b"half x"), "header line that cannot be read: `property half x`"),
        (CLOUD.replace(b"float y", b"float x"), "lists an element or a property twice"),
        (CLOUD.replace(b"element vertex", b"element chunk"), "is a compressed Gaussian PLY with other properties"),
        (CLOUD.replace(b"element vertex", b"element face"), "has no plain `vertex` element"),
        (CLOUD.replace(b"float x", b"list uchar int x"), "has no plain `vertex` element"),
    ],
)
def test_other_files_are_refused_with_a_reason(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "file.ply"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=sentence) as caught:
        read_ply(path)
    assert str(path) in str(caught.value)


def test_the_error_for_a_truncated_file_states_how_much_is_missing(
    tmp_path: Path, random_gaussians: RandomGaussians
) -> None:
    path = tmp_path / "scene.ply"
    write_ply(path, random_gaussians(10, degree=0))
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(FormatError, match="truncated: its header states 10 Gaussians and it has 9"):
        read_ply(path)


def test_incomplete_spherical_harmonics_are_refused(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    path = tmp_path / "scene.ply"
    write_ply(path, random_gaussians(2, degree=1))
    path.write_bytes(path.read_bytes().replace(b"f_rest_8", b"f_same_8"))
    with pytest.raises(FormatError, match="has 8 `f_rest` properties"):
        read_ply(path)


def test_a_missing_file_is_reported_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"nowhere\.ply cannot be read: .*Check the path"):
        read_ply(tmp_path / "nowhere.ply")


def test_broken_gaussians_are_refused_or_skipped_on_request(
    tmp_path: Path, random_gaussians: RandomGaussians, assert_same_gaussians: Callable[..., None]
) -> None:
    path = tmp_path / "scene.ply"
    gaussians = random_gaussians(5, degree=0)
    write_ply(path, gaussians)
    data = bytearray(path.read_bytes())
    data[-4:] = np.float32(np.nan).tobytes()
    path.write_bytes(data)
    with pytest.raises(FormatError, match="1 of 5 Gaussians with values that are not finite"):
        read_ply(path)
    assert_same_gaussians(read_ply(path, skip_broken=True), gaussians[slice(4)])


def test_values_that_are_not_finite_are_never_written(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(5, degree=0)
    gaussians.log_scales[3, 1] = np.inf
    with pytest.raises(NumericalError, match="1 of 15 values of `log_scales`"):
        write_ply(tmp_path / "scene.ply", gaussians)
    assert list(tmp_path.iterdir()) == []


def test_values_that_are_not_finite_are_not_written_turned_either(
    tmp_path: Path, random_gaussians: RandomGaussians
) -> None:
    gaussians = random_gaussians(5, degree=1)
    gaussians.sh[3, 2, 1] = np.nan
    with pytest.raises(NumericalError, match="1 of 60 values of `sh`"):
        write_ply(tmp_path / "scene.ply", gaussians, up="-y")
    # Finite, but not after they are made a hundred times larger.
    gaussians = random_gaussians(5, degree=1)
    gaussians.means[0, 0] = 1e37
    with pytest.raises(NumericalError, match="1 of 15 values of `means`"):
        write_ply(tmp_path / "scene.ply", gaussians, matrix=np.diag([100.0, 100.0, 100.0, 1.0]))
    assert list(tmp_path.iterdir()) == []


def test_values_whose_sum_overflows_are_written(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(4, degree=1)
    gaussians.opacity_logits[...] = 3e38
    write_ply(tmp_path / "scene.ply", gaussians)
    stored = np.fromfile(tmp_path / "scene.ply", "<f4", offset=(tmp_path / "scene.ply").stat().st_size - 4 * 26 * 4)
    np.testing.assert_array_equal(stored.reshape(4, 26)[:, 18], gaussians.opacity_logits)


def test_infinite_opacity_logits_mean_opaque_and_transparent(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    path = tmp_path / "scene.ply"
    gaussians = random_gaussians(2, degree=0)
    gaussians.opacity_logits[:] = 123.0, -123.0
    write_ply(path, gaussians)
    data = path.read_bytes()
    for value, infinite in ((123.0, np.inf), (-123.0, -np.inf)):
        data = data.replace(np.float32(value).tobytes(), np.float32(infinite).tobytes())
    path.write_bytes(data)
    back = read_ply(path)
    assert np.isfinite(back.opacity_logits).all()
    np.testing.assert_allclose(back.opacities, [1, 0], atol=6e-8)


def header(*lines: str, count: int | str = 1) -> bytes:
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"]
    names += ["rot_0", "rot_1", "rot_2", "rot_3"]
    properties = [f"property float {name}" for name in names]
    text = ["ply", "format binary_little_endian 1.0", *lines, f"element vertex {count}", *properties, "end_header", ""]
    return "\n".join(text).encode()


def test_a_header_of_the_tests_is_a_scene(tmp_path: Path) -> None:
    (tmp_path / "file.ply").write_bytes(header() + bytes(56))
    assert len(read_ply(tmp_path / "file.ply")) == 1


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (header(count=1_000_000_000_000) + bytes(56), "is truncated: its header states 1000000000000 .* it has 1"),
        (header(count="9" * 400), "header line that cannot be read: `element vertex 9{65}`"),
        (header(count=-1) + bytes(56), "header line that cannot be read: `element vertex -1`"),
        (header(count="1_0") + bytes(560), "header line that cannot be read"),
        (header(count="١") + bytes(56), "header line that cannot be read"),
        (header(count=0), "has no Gaussians: its list is empty"),
        (header("element vertex 1", "property float x") + bytes(60), "lists an element or a property twice"),
        (header("property float x") + bytes(56), "header line that cannot be read: `property float x`"),
        (header("element a 999999999999", "property double b") + bytes(99), "truncated: .* 999999999999 rows of `a`"),
        (header("element a 1", *(f"property float p{i}" for i in range(1001))), "more than 1000 properties"),
        (header(*["comment"] * 20_000) + bytes(56), "header does not end"),
        (header("comment " + "x" * (1 << 20)) + bytes(56), "header does not end"),
    ],
)
def test_a_count_or_a_header_that_the_file_cannot_have_allocates_nothing(
    tmp_path: Path, content: bytes, sentence: str
) -> None:
    path = tmp_path / "file.ply"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=sentence):
        read_ply(path)
    with pytest.raises(FormatError, match=sentence):
        read_ply(path, skip_broken=True)


def test_a_file_that_needs_more_memory_than_is_free_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("engine.formats.bounds.free_memory", lambda: 1 << 20)
    path = tmp_path / "file.ply"
    with path.open("wb") as stream:  # a hole takes no space on the disk
        stream.write(header(count=3_000_000))
        stream.truncate(stream.tell() + 3_000_000 * 56)
    with pytest.raises(FormatError, match="takes 0.3 GB of memory to read, and 0.0 GB are free"):
        read_ply(path)


@pytest.mark.parametrize(("name", "value"), [("means", 1e30), ("log_scales", 60.0), ("sh", -1e25), ("quats", 1e20)])
def test_values_too_large_to_compute_with_count_as_broken(
    tmp_path: Path, name: str, value: float, random_gaussians: RandomGaussians
) -> None:
    gaussians = random_gaussians(3, degree=0)
    getattr(gaussians, name).reshape(3, -1)[1, 0] = value
    write_ply(tmp_path / "scene.ply", gaussians)
    with pytest.raises(FormatError, match="1 of 3 Gaussians with values that are not finite or too large"):
        read_ply(tmp_path / "scene.ply")
    assert len(read_ply(tmp_path / "scene.ply", skip_broken=True)) == 2


@pytest.mark.filterwarnings("error")
def test_a_double_that_float32_cannot_hold_is_broken_without_a_warning(tmp_path: Path) -> None:
    content = header(count=1).replace(b"property float x", b"property double x")
    (tmp_path / "file.ply").write_bytes(content + np.float64(1e300).tobytes() + bytes(52))
    with pytest.raises(FormatError, match="1 of 1 Gaussians"):
        read_ply(tmp_path / "file.ply")
    with pytest.raises(FormatError, match="has no Gaussian whose values are all finite"):
        read_ply(tmp_path / "file.ply", skip_broken=True)


def test_a_folder_is_no_scene(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="it is not a file"):
        read_ply(tmp_path)
