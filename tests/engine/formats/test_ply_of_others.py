"""Files of other programs: compressed ones are decoded as their own program does, and untouched files stay as they are.

The files in tests/fixtures/formats were written by splat-transform 2.7.1 from seven random Gaussians.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import FormatError
from engine.formats.axes import file_from_z_up
from engine.formats.ply import read_ply, read_ply_file, write_ply
from engine.formats.transform import transform_gaussians
from engine.scene import rotations_from_quats

from .conftest import RandomGaussians

FIXTURES = Path(__file__).resolve().parents[2] / "fixtures"
COMPRESSED = FIXTURES / "formats" / "playcanvas.compressed.ply"


def test_a_compressed_file_has_the_values_that_its_own_program_decodes() -> None:
    ours, theirs = read_ply(COMPRESSED), read_ply(FIXTURES / "formats" / "playcanvas.ply")
    for name in ("means", "log_scales", "opacities", "sh"):
        # One rounding of float32 of values up to 8.
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-6, err_msg=name)
    np.testing.assert_allclose(rotations_from_quats(ours.quats), rotations_from_quats(theirs.quats), atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (b"element chunk 1\n", b"element chunk 0\n", "has 0 chunks for 7 Gaussians"),
        (b"element sh 7\n", b"element sh 3\n", "has harmonics for 3 of 7 Gaussians"),
        (b"packed_color", b"packed_other", "other properties of `vertex` than PlayCanvas writes"),
        (b"element vertex 7\n", b"element vertex 0\n", "its list is empty"),
        (b"element sh 7\n", b"element sh 70000000000\n", "is truncated: its header states 70000000000 rows of `sh`"),
    ],
)
def test_a_damaged_compressed_file_is_refused_with_a_reason(
    tmp_path: Path, old: bytes, new: bytes, sentence: str
) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(COMPRESSED.read_bytes().replace(old, new))
    with pytest.raises(FormatError, match=sentence):
        read_ply(path)


def test_an_untouched_file_is_written_again_byte_for_byte(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    first, second = tmp_path / "a.ply", tmp_path / "b.ply"
    photos = np.arange(9, dtype=np.float32)
    write_ply(first, random_gaussians(9), up="-y", comments=["title Vase"], extra={"photos_seen": photos})
    content = read_ply_file(first)
    np.testing.assert_array_equal(content.extra["photos_seen"], photos)
    write_ply(second, content.gaussians, extra=content.extra, header=content.header)
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize("order", ["little", "big"])
def test_a_layout_of_another_program_stays_as_it_is(
    tmp_path: Path, order: str, random_gaussians: RandomGaussians
) -> None:
    gaussians = random_gaussians(5, degree=0)
    names = ["opacity", *(f"rot_{i}" for i in range(4)), "x", "y", "z", *(f"scale_{i}" for i in range(3))]
    names += [f"f_dc_{i}" for i in range(3)]
    sign = "<" if order == "little" else ">"
    rows = np.zeros(5, np.dtype([*((name, f"{sign}f4") for name in names), ("label", "u1"), ("id", f"{sign}i4")]))
    rows["opacity"], rows["label"], rows["id"] = gaussians.opacity_logits, range(5), range(70_000, 70_005)
    groups = (("rot_{}", gaussians.quats), ("scale_{}", gaussians.log_scales), ("f_dc_{}", gaussians.sh[:, 0]))
    for pattern, values in groups:
        for i in range(values.shape[1]):
            rows[pattern.format(i)] = values[:, i]
    lines = ["ply", f"format binary_{order}_endian 1.0", "comment made elsewhere", "element vertex 5"]
    lines += [
        *(f"property float {name}" for name in names),
        "property uchar label",
        "property int id",
        "end_header",
        "",
    ]
    path = tmp_path / "other.ply"
    path.write_bytes("\n".join(lines).encode() + rows.tobytes())
    content = read_ply_file(path)
    assert content.up is None and content.extra["id"].tolist() == list(range(70_000, 70_005))
    write_ply(tmp_path / "again.ply", content.gaussians, extra=content.extra, header=content.header)
    assert path.read_bytes() == (tmp_path / "again.ply").read_bytes()


def test_the_axis_that_a_file_states_is_turned_up_again(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(20)
    write_ply(tmp_path / "a.ply", gaussians, up="-y")
    stored, back = read_ply_file(tmp_path / "a.ply"), read_ply(tmp_path / "a.ply")
    assert stored.up == "-y"
    # The scene stands on its feet where -Y is up.
    np.testing.assert_array_equal(stored.gaussians.means, gaussians.means[:, [0, 2, 1]] * (1, -1, 1))
    np.testing.assert_array_equal(back.means, gaussians.means)
    # Two rotations of the harmonics in float32.
    np.testing.assert_allclose(back.sh, gaussians.sh, atol=1e-5 * np.abs(gaussians.sh).max())
    expected = transform_gaussians(gaussians, file_from_z_up("-y"))
    np.testing.assert_array_equal(stored.gaussians.sh, expected.sh)


def test_normals_of_other_programs_are_kept_where_they_say_something(
    tmp_path: Path, random_gaussians: RandomGaussians
) -> None:
    path = tmp_path / "a.ply"
    write_ply(path, random_gaussians(4))
    assert read_ply_file(path).extra == {}
    normals = {name: np.full(4, 0.5, np.float32) for name in ("nx", "ny", "nz")}
    write_ply(path, random_gaussians(4), extra=normals)
    assert sorted(read_ply_file(path).extra) == ["nx", "ny", "nz"]
