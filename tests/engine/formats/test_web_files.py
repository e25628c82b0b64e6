"""SPLAT and KSPLAT files are read as other programs read them, and damaged ones are refused."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import FormatError
from engine.formats import kind_of, read_ksplat, read_other, read_ply_file, read_splat
from engine.pictures import decode_picture
from engine.scene import rotations_from_quats
from engine.scene.gaussians import Gaussians

FILES = Path(__file__).resolve().parents[2] / "fixtures" / "formats"
SOURCE = read_ply_file(FILES / "niantic_3.ply").gaussians
"""From these were made level_0.ksplat to level_2.ksplat and gsplat.splat."""


def assert_alike(found: Gaussians, means: float, scales: float, rotations: float, sh: float) -> None:
    """Compare with the source, whose order GaussianSplats3D changes."""
    order, wanted = np.argsort(found.means[:, 0]), np.argsort(SOURCE.means[:, 0])
    found, expected = found[order], SOURCE[wanted]
    np.testing.assert_allclose(found.means, expected.means, atol=means)
    np.testing.assert_allclose(found.log_scales, expected.log_scales, atol=scales)
    turns = rotations_from_quats(found.quats), rotations_from_quats(expected.quats)
    np.testing.assert_allclose(*turns, atol=rotations)
    # Both have colours and opacities of 8 bits; one program rounds them, the other cuts them off.
    np.testing.assert_allclose(found.opacities, expected.opacities, atol=1.01 / 255)
    color = 0.5 + 0.28209479 * expected.sh[:, 0]
    np.testing.assert_allclose(0.5 + 0.28209479 * found.sh[:, 0], color.clip(0, 1), atol=1.01 / 255)
    if sh:
        np.testing.assert_allclose(found.sh[:, 1:], expected.sh[:, 1:], atol=sh)


@pytest.mark.parametrize(
    ("level", "means", "scales", "rotations", "sh"),
    # Level 1: positions in steps of 2.5/32767 and half precision; level 2: harmonics in steps of 3/255, too.
    [(0, 0.0, 1e-6, 1e-6, 1e-7), (1, 8e-5, 1e-3, 2e-3, 1e-3), (2, 8e-5, 1e-3, 2e-3, 1.01 * 3 / 255)],
)
def test_ksplat_of_its_own_program_is_read(
    level: int, means: float, scales: float, rotations: float, sh: float
) -> None:
    assert_alike(read_ksplat(FILES / f"level_{level}.ksplat", up="z"), means, scales, rotations, sh)


def test_splat_of_another_program_is_read() -> None:
    found = read_splat(FILES / "gsplat.splat", up="z")
    # A component of a rotation is cut off to 8 bits: 2/255, which counts several times in a matrix.
    assert_alike(found, 0.0, 1e-6, 6 / 255, 0.0)
    turned = read_splat(FILES / "gsplat.splat")
    np.testing.assert_allclose(turned.means, found.means[:, [0, 2, 1]] * (1, 1, -1), atol=1e-6)


def test_more_gaussians_than_a_bucket_holds_are_placed_by_theirs(tmp_path: Path) -> None:
    # Two full buckets of two, and two others of one and two, written by the layout.
    n_full, lengths, size = 2, (1, 2), 2
    count = n_full * size + sum(lengths)
    middles = np.arange(12, dtype="<f4").reshape(4, 3)
    rows = np.zeros(count, [("p", "<u2", 3), ("s", "<f2", 3), ("q", "<f2", 4), ("c", "u1", 4)])
    rows["p"], rows["s"], rows["q"] = 32767 + np.arange(count)[:, None], 0.5, (1, 0, 0, 0)
    head = bytearray(4096)
    struct.pack_into("<BBxxIIIIH", head, 0, 0, 1, 1, 1, count, count, 1)
    section = bytearray(1024)
    struct.pack_into("<IIIIfHxxIIII", section, 0, count, count, size, 4, 5.0, 12, 32767, 0, n_full, len(lengths))
    data = bytes(head + section) + np.array(lengths, "<u4").tobytes() + middles.tobytes() + rows.tobytes()
    (tmp_path / "a.ksplat").write_bytes(data)
    found = read_ksplat(tmp_path / "a.ksplat", up="z").means
    bucket = np.array([0, 0, 1, 1, 2, 3, 3])
    np.testing.assert_allclose(found, middles[bucket] + np.arange(7)[:, None] * 2.5 / 32767, atol=1e-6)
    struct.pack_into("<I", section, 36, 1)
    (tmp_path / "a.ksplat").write_bytes(bytes(head + section) + data[5120:])
    with pytest.raises(FormatError, match="its buckets hold|truncated"):
        read_ksplat(tmp_path / "a.ksplat")


@pytest.mark.parametrize(
    ("offset", "value", "said"),
    [
        (0, b"\1", "not a KSPLAT file of a version that is known"),
        (4, struct.pack("<I", 10**6), "1000000 sections"),
        (16, struct.pack("<I", 10**6), "have 7 of 1000000 Gaussians"),
        (20, b"\7", "of the level 7"),
        (4096, struct.pack("<II", 10**6, 10**6), "truncated|of 7 Gaussians"),
        (4096 + 40, b"\5", "harmonics of degree 5"),
    ],
)
def test_damaged_ksplat_is_refused(tmp_path: Path, offset: int, value: bytes, said: str) -> None:
    data = bytearray((FILES / "level_1.ksplat").read_bytes())
    data[offset : offset + len(value)] = value
    (tmp_path / "a.ksplat").write_bytes(data)
    with pytest.raises(FormatError, match=said):
        read_ksplat(tmp_path / "a.ksplat")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "has 0 bytes"),
        (bytes(33), "has 33 bytes, and Gaussians have 32 each"),
        (struct.pack("<6f", 0, 0, 0, -1, 1, 1) + bytes(8), "negative sizes"),
        (struct.pack("<6f", 0, 0, 1e30, 1, 1, 1) + bytes(8), "not finite or too large"),
        (struct.pack("<6f", 0, 0, np.nan, 1, 1, 1) + bytes(8), "not finite or too large"),
    ],
)
def test_what_is_no_splat_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "a.splat").write_bytes(content)
    with pytest.raises(FormatError, match=said):
        read_splat(tmp_path / "a.splat")


@pytest.mark.parametrize(
    ("source", "name", "kind"),
    [
        ("playcanvas.ply", "a.splat", "ply"),
        ("niantic_3.spz", "a.ply", "spz"),
        ("niantic_4.spz", "a.sog", "spz"),
        ("playcanvas.sog", "a.zip", "sog"),
        ("gsplat.splat", "a.splat", "splat"),
        ("level_0.ksplat", "a.ksplat", "ksplat"),
    ],
)
def test_a_file_is_known_by_its_content(tmp_path: Path, source: str, name: str, kind: str) -> None:
    (tmp_path / name).write_bytes((FILES / source).read_bytes())
    assert kind_of(tmp_path / name) == kind
    if kind in ("splat", "ksplat", "sog"):
        assert len(read_other(tmp_path / name, kind, decode_picture)) == 7


def test_another_kind_of_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_bytes(b"hello")
    with pytest.raises(FormatError, match="none of PLY, SPZ, GLB, SOG, SPLAT and KSPLAT"):
        kind_of(tmp_path / "a.txt")
