"""What other programs write into a PLY: anti-aliased training, double coordinates, and 2D Gaussians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import FormatError, ObjectError
from engine.formats import FileFacts, read_glb, read_ply, read_ply_file, write_glb, write_ply, write_spz

from .conftest import RandomGaussians

NAMES = ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1")
NAMES = (*NAMES, "rot_2", "rot_3")
UTM = (500_123.25, 4_649_876.5, 1_035.125)


def write_rows(
    path: Path, values: np.ndarray, *, comments: Sequence[str] = (), kind: str = "float", without: str = ""
) -> None:
    """Write a PLY whose coordinates are of the type `kind`."""
    types = {"float": "<f4", "double": "<f8", "int": "<i4"}
    names = [name for name in NAMES if name != without]
    rows = np.zeros(len(values), [(name, types[kind if name in "xyz" else "float"]) for name in names])
    for column, name in enumerate(NAMES):
        if name != without:
            rows[name] = values[:, column]
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in comments)]
    lines += [f"element vertex {len(rows)}"]
    lines += [f"property {kind if name in 'xyz' else 'float'} {name}" for name in names]
    path.write_bytes("\n".join([*lines, "end_header", ""]).encode() + rows.tobytes())


def values(count: int, center: Sequence[float] = (0, 0, 0)) -> np.ndarray:
    found = np.random.default_rng(0).normal(size=(count, len(NAMES)))
    found[:, :3] += center
    return found


@pytest.mark.parametrize(
    ("comments", "said"),
    [
        (["SplatRenderMode: mip"], True),
        (["splatrendermode:MIP"], True),
        (["SplatRenderMode: default"], False),
        (["antialiased 1"], True),
        (["antialiased: true"], True),
        (["antialiased 0"], False),
        (["antialiased 0", "SplatRenderMode: mip"], True),
        (["title an antialiased 1 lamp"], False),
        ([], False),
    ],
)
def test_marks_of_anti_aliased_training_are_read(tmp_path: Path, comments: list[str], said: bool) -> None:
    write_rows(tmp_path / "a.ply", values(5), comments=comments)
    file = read_ply_file(tmp_path / "a.ply")
    assert file.gaussians.antialiased == file.antialiased == said
    assert any("anti-aliased" in note for note in file.notes) == said
    assert read_ply(tmp_path / "a.ply").antialiased == said
    assert file.gaussians[1:3].antialiased == said


def test_the_mark_is_written_with_and_without_the_header_of_the_file(
    tmp_path: Path, random_gaussians: RandomGaussians
) -> None:
    plain = random_gaussians(4, degree=0)
    mip = replace(plain, antialiased=True)
    write_ply(tmp_path / "new.ply", mip, up="-y", comments=["title Vase"])
    assert b"comment SplatRenderMode: mip\n" in (tmp_path / "new.ply").read_bytes()
    write_rows(tmp_path / "a.ply", values(4), comments=["Exported from Brush", "SplatRenderMode: mip"])
    header = read_ply_file(tmp_path / "a.ply").header
    write_ply(tmp_path / "b.ply", mip, header=header)
    assert read_ply_file(tmp_path / "b.ply").header == header
    # What the Gaussians are counts more than what the header said.
    write_ply(tmp_path / "b.ply", plain, header=header)
    assert not read_ply_file(tmp_path / "b.ply").antialiased
    write_ply(tmp_path / "b.ply", mip, header=[line for line in header if "Mode" not in line])
    assert read_ply_file(tmp_path / "b.ply").antialiased
    write_glb(tmp_path / "a.glb", mip)
    assert read_glb(tmp_path / "a.glb").antialiased
    write_glb(tmp_path / "a.glb", plain, FileFacts(extras={"title": "Vase"}))
    assert not read_glb(tmp_path / "a.glb").antialiased


def test_anti_aliased_gaussians_and_others_are_not_mixed(random_gaussians: RandomGaussians) -> None:
    plain = random_gaussians(3)
    mip = replace(plain, antialiased=True)
    assert mip.joined(mip).antialiased and len(mip.joined(mip)) == 6
    assert mip.joined(plain[:0]).antialiased and plain[:0].joined(mip).antialiased
    with pytest.raises(ObjectError, match="cannot be put together"):
        mip.joined(plain)


@pytest.mark.parametrize("kind", ["double", "int"])
def test_coordinates_far_from_zero_keep_their_digits(tmp_path: Path, kind: str) -> None:
    stated = values(300, UTM)
    if kind == "int":  # Centimetres, for instance.
        stated[:, :3] = np.round(stated[:, :3] * 100)
    write_rows(tmp_path / "a.ply", stated, kind=kind)
    file = read_ply_file(tmp_path / "a.ply")
    places = file.origin + file.gaussians.means
    # Float32 has 24 bits of the distance from the origin.
    np.testing.assert_allclose(places, stated[:, :3], rtol=0, atol=np.ptp(stated[:, :3], axis=0).max() * 2**-23)
    assert (np.abs(file.origin - stated[:, :3].mean(axis=0)) < np.ptp(stated[:, :3], axis=0)).all()
    # Whole numbers that float32 holds, as Blender's locations are float32.
    assert (file.origin == np.float32(np.round(file.origin))).all()
    assert "far from 0" in file.notes[0]
    matrix = np.eye(4)
    matrix[:3, 3] = file.origin
    write_ply(tmp_path / "b.ply", file.gaussians, header=file.header, matrix=matrix, lost=file.lost)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
    # Also as a new file, in which they are doubles.
    write_ply(tmp_path / "c.ply", file.gaussians, up="-y", matrix=matrix @ np.diag((1, -1, -1, 1.0)), lost=file.lost)
    assert b"property double x" in (tmp_path / "c.ply").read_bytes()
    again = read_ply_file(tmp_path / "c.ply")
    np.testing.assert_allclose(np.ptp(again.gaussians.means, axis=0)[[0, 2, 1]], np.ptp(places, axis=0), rtol=1e-5)


def test_doubles_near_zero_and_floaters_far_away_move_nothing(tmp_path: Path) -> None:
    near = values(200)
    near[0, :3] = 1e6
    write_rows(tmp_path / "a.ply", near, kind="double")
    file = read_ply_file(tmp_path / "a.ply")
    assert not file.origin.any() and file.notes == ()
    np.testing.assert_array_equal(file.gaussians.means, near[:, :3].astype(np.float32))
    write_ply(tmp_path / "b.ply", file.gaussians, header=file.header, lost=file.lost)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
    # A floater at 0 does not keep what is far away from being taken off.
    far = values(200, UTM)
    far[0, :3] = 0
    write_rows(tmp_path / "a.ply", far, kind="double")
    assert read_ply_file(tmp_path / "a.ply").origin[1] > 4e6


def test_floats_are_read_as_they_are(tmp_path: Path) -> None:
    write_rows(tmp_path / "a.ply", values(20, UTM))
    file = read_ply_file(tmp_path / "a.ply")
    assert not file.origin.any() and file.lost is None


def test_formats_of_float32_refuse_what_is_moved_too_far(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    matrix = np.eye(4)
    matrix[:3, 3] = UTM
    for write, name in ((write_glb, "a.glb"), (write_spz, "a.spz")):
        with pytest.raises(FormatError, match=rf"{name}.*around \(500123, 4649876, 1035\).*Export PLY"):
            write(tmp_path / name, random_gaussians(50), FileFacts(matrix=matrix))
    # A metre or a hundred are no matter.
    matrix[:3, 3] = (100, 1, 0)
    write_glb(tmp_path / "a.glb", random_gaussians(50), FileFacts(matrix=matrix))


def test_2d_gaussians_are_flat_ones_and_are_named(tmp_path: Path) -> None:
    stated = values(20)
    write_rows(tmp_path / "a.ply", stated, without="scale_2")
    file = read_ply_file(tmp_path / "a.ply")
    np.testing.assert_allclose(file.gaussians.log_scales[:, :2], stated[:, 7:9], rtol=1e-6)
    np.testing.assert_allclose(file.gaussians.scales[:, 2], 1e-6, rtol=1e-5)
    assert file.is_flat and file.notes == ("They are 2D Gaussians (2DGS), read as flat ones.",)
    write_ply(tmp_path / "b.ply", file.gaussians, header=file.header)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()
    write_rows(tmp_path / "c.ply", stated, without="scale_1")
    with pytest.raises(FormatError, match="it has no scale_1"):
        read_ply_file(tmp_path / "c.ply")
