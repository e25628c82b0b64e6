"""SPZ files are read as other programs read them, hold what they promise to hold, and others are refused."""

from __future__ import annotations

import gzip
import struct
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from engine.core.errors import EnvironmentProblem, FormatError, NumericalError
from engine.formats.axes import file_from_z_up
from engine.formats.facts import FileFacts
from engine.formats.ply import read_ply
from engine.formats.spz import read_spz, write_spz
from engine.formats.transform import transform_gaussians
from engine.scene import rotations_from_quats
from engine.scene.gaussians import Gaussians

from .conftest import RandomGaussians

FOLDER = Path(__file__).resolve().parents[2] / "fixtures" / "formats"


def covariances(gaussians: Gaussians) -> np.ndarray:
    axes = rotations_from_quats(gaussians.quats) * gaussians.scales[:, None, :]
    return axes @ axes.transpose(0, 2, 1)


def test_a_file_of_splat_transform_is_read_as_it_reads_it() -> None:
    # That program turns it to -Y up.
    ours = transform_gaussians(read_spz(FOLDER / "niantic_3.spz"), file_from_z_up("-y"))
    theirs = read_ply(FOLDER / "niantic_3.ply")
    for name in ("means", "log_scales", "opacities", "sh"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-6, err_msg=name)
    np.testing.assert_allclose(covariances(ours), covariances(theirs), rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_written_values_differ_by_half_a_step_at_most(
    tmp_path: Path, degree: int, random_gaussians: RandomGaussians
) -> None:
    gaussians = random_gaussians(500, degree=degree)
    gaussians = replace(gaussians, sh=gaussians.sh.clip(-0.9, 0.9))
    write_spz(tmp_path / "a.spz", gaussians)
    back = read_spz(tmp_path / "a.spz")
    assert back.sh.shape == gaussians.sh.shape
    # 99 % of the positions span 2^13 steps.
    np.testing.assert_allclose(back.means, gaussians.means, atol=0.51 * 4 / 2**13)
    np.testing.assert_allclose(back.log_scales, gaussians.log_scales, atol=0.5 / 16 + 1e-6)
    np.testing.assert_allclose(back.opacities, gaussians.opacities, atol=0.5 / 255 + 1e-6)
    # A component of a rotation has 511 steps up to sqrt(1/2).
    np.testing.assert_allclose(
        rotations_from_quats(back.quats), rotations_from_quats(gaussians.quats), atol=8 * 0.5 / 511
    )
    if degree == 0:
        np.testing.assert_allclose(back.sh[:, 0], gaussians.sh[:, 0], atol=0.5 / (0.15 * 255) + 1e-6)


def test_harmonics_of_an_upright_file_differ_by_half_a_step(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(300)
    gaussians = replace(gaussians, sh=gaussians.sh.clip(-0.5, 0.5))
    # With this matrix, the values of the file are those of the Gaussians.
    write_spz(tmp_path / "a.spz", gaussians, FileFacts(matrix=file_from_z_up("-y")))
    back = transform_gaussians(read_spz(tmp_path / "a.spz"), file_from_z_up("-y").T)
    # Half a step of 8 or 16, and the rounding to whole numbers before it.
    np.testing.assert_allclose(back.sh[:, 1:4], gaussians.sh[:, 1:4], atol=4.5 / 128 + 1e-5)
    np.testing.assert_allclose(back.sh[:, 4:], gaussians.sh[:, 4:], atol=8.5 / 128 + 1e-5)


def test_an_object_of_a_few_centimetres_keeps_its_form(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    gaussians = random_gaussians(500, degree=0)
    small = replace(gaussians, means=0.02 * gaussians.means)
    write_spz(tmp_path / "a.spz", small)
    np.testing.assert_allclose(read_spz(tmp_path / "a.spz").means, small.means, atol=0.02 * 4 / 2**13)


def test_a_far_gaussian_takes_bits_from_the_others_and_one_too_far_is_refused(
    tmp_path: Path, random_gaussians: RandomGaussians
) -> None:
    gaussians = random_gaussians(500, degree=0)
    gaussians.means[7] = (1e6, 0, 0)
    write_spz(tmp_path / "a.spz", gaussians)
    np.testing.assert_allclose(read_spz(tmp_path / "a.spz").means, gaussians.means, atol=0.51 / 8)
    gaussians.means[7] = (1e7, 0, 0)
    with pytest.raises(FormatError, match="Gaussians 1e[+]07 units away; SPZ is limited to 8388607"):
        write_spz(tmp_path / "b.spz", gaussians)
    gaussians.means[7] = np.nan
    with pytest.raises(NumericalError, match="`means` are not finite"):
        write_spz(tmp_path / "b.spz", gaussians)
    assert not (tmp_path / "b.spz").exists()


def packed(version: int, rotation: bytes, *, count: int = 1, degree: int = 0, magic: int = 0x5053474E) -> bytes:
    """Return one Gaussian at (1, -2, 3) in steps of 1/4."""
    header = struct.pack("<IIIBBBB", magic, version, count, degree, 2, 0, 0)
    positions = b"".join(struct.pack("<i", value)[:3] for value in (4, -8, 12))
    return header + positions + b"\xff" + b"\x80\x80\x80" + b"\xa0\xa0\xa0" + rotation


def test_version_2_has_rotations_of_three_bytes(tmp_path: Path) -> None:
    (tmp_path / "a.spz").write_bytes(gzip.compress(packed(2, b"\xff\x80\x80")))
    back = read_spz(tmp_path / "a.spz")
    np.testing.assert_array_equal(back.means, [[1, -3, -2]])
    np.testing.assert_array_equal(back.log_scales, [[0, 0, 0]])
    assert back.opacities[0] > 0.9999
    # Half a turn about X, and a quarter turn from the axes of the file to ours.
    expected = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]) @ np.diag([1, -1, -1])
    np.testing.assert_allclose(rotations_from_quats(back.quats)[0], expected, atol=0.02)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "is not an SPZ file"),
        (b"ply\n", "is not an SPZ file"),
        (gzip.compress(b"x" * 16), "is not an SPZ file"),
        (gzip.compress(b"x"), "is truncated"),
        (gzip.compress(packed(2, b"\x80" * 3))[:-20], "is (a damaged SPZ file|truncated)"),
        (gzip.compress(packed(2, b"\x80" * 3))[:12], "is truncated"),
        (gzip.compress(packed(2, b"\x80")), "is truncated: it ends before its last Gaussian"),
        (gzip.compress(packed(3, b"\x80" * 5)), "is longer than its header states"),
        (gzip.compress(packed(1, b"\x80" * 3)), "is SPZ 1; versions 2 to 4 are supported"),
        (gzip.compress(packed(3, b"\x80" * 4, count=0)), "has 0 Gaussians"),
        (gzip.compress(packed(3, b"\x80" * 4, count=10_000_001)), "has 10000001 Gaussians"),
        (gzip.compress(packed(3, b"\x80" * 4, count=9_999_999)), "is truncated"),
        (gzip.compress(packed(3, b"\x80" * 4, degree=4)), "harmonics of degree 4"),
        (gzip.compress(packed(3, b"\x80" * 4) + bytes(50_000_000)), "is longer than its header states"),
    ],
)
def test_other_files_are_refused_with_a_reason(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "a.spz"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=sentence) as caught:
        read_spz(path)
    assert str(path) in str(caught.value)


def test_version_4_is_read_as_version_3() -> None:
    pytest.importorskip("zstandard", reason="zstandard is optional: requirements/formats.txt")
    found, expected = read_spz(FOLDER / "niantic_4.spz"), read_spz(FOLDER / "niantic_3.spz")
    for name in ("means", "log_scales", "quats", "opacity_logits", "sh"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


@pytest.mark.parametrize(
    ("offset", "value", "said"),
    [
        (4, b"\5", "is SPZ 5; versions 2 to 4 are supported"),
        (8, b"\xff\xff\xff\x7f", "has 2147483647 Gaussians"),
        (8, b"\x08", "has 63 bytes instead of 72"),
        (15, b"\5", "has 5 streams instead of 6"),
        (16, b"\x10", "whose table is at 16"),
        (16, b"\xff\xff", "is truncated"),
        (32, b"\xff\xff\xff", "is truncated"),
        (40, b"\xff\xff\xff", "instead of 63"),
        (128, b"abcd", "is a damaged SPZ file"),
    ],
)
def test_damaged_version_4_is_refused_with_a_reason(tmp_path: Path, offset: int, value: bytes, said: str) -> None:
    pytest.importorskip("zstandard", reason="zstandard is optional: requirements/formats.txt")
    data = bytearray((FOLDER / "niantic_4.spz").read_bytes())
    data[offset : offset + len(value)] = value
    (tmp_path / "a.spz").write_bytes(data)
    with pytest.raises(FormatError, match=said):
        read_spz(tmp_path / "a.spz")
    (tmp_path / "a.spz").write_bytes((FOLDER / "niantic_4.spz").read_bytes() + b"more")
    with pytest.raises(FormatError, match="longer than its header states"):
        read_spz(tmp_path / "a.spz")


def test_a_stream_that_unpacks_to_more_than_it_states_is_not_unpacked_further(tmp_path: Path) -> None:
    zstandard = pytest.importorskip("zstandard", reason="zstandard is optional: requirements/formats.txt")
    data = (FOLDER / "niantic_4.spz").read_bytes()
    bomb = zstandard.compress(bytes(1 << 28), 19)
    sizes = list(struct.unpack_from("<12Q", data, 32))
    rest = data[128 + sizes[0] :]
    sizes[0] = len(bomb)
    (tmp_path / "a.spz").write_bytes(data[:32] + struct.pack("<12Q", *sizes) + bomb + rest)
    tracemalloc.start()
    with pytest.raises(FormatError, match="64 or more bytes instead of 63"):
        read_spz(tmp_path / "a.spz")
    assert tracemalloc.get_traced_memory()[1] < 8 << 20
    tracemalloc.stop()


def test_version_4_without_its_package_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zstandard", None)
    with pytest.raises(EnvironmentProblem, match=r"zstandard.*requirements/formats\.txt.*SPZ 3, PLY or GLB"):
        read_spz(FOLDER / "niantic_4.spz")


def test_the_flag_of_anti_aliased_training_is_read_and_written(
    tmp_path: Path, random_gaussians: RandomGaussians
) -> None:
    for antialiased in (False, True):
        write_spz(tmp_path / "a.spz", replace(random_gaussians(5), antialiased=antialiased))
        assert read_spz(tmp_path / "a.spz").antialiased == antialiased
        assert gzip.decompress((tmp_path / "a.spz").read_bytes())[14] == antialiased


def test_another_axis_may_be_up() -> None:
    up, down = (read_spz(FOLDER / "niantic_3.spz", up=up) for up in ("y", "-y"))
    np.testing.assert_allclose(down.means, up.means * (1, -1, -1), atol=1e-6)
