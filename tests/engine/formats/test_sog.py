"""SOG files are read as PlayCanvas' own program reads them, hold what they promise to hold, and others are refused."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engine.core.errors import FormatError, NumericalError
from engine.formats import FileFacts, read_ply_file, read_sog, write_sog
from engine.formats.codebooks import codebook, palette
from engine.pictures import decode_picture, encode_picture
from engine.scene import rotations_from_quats
from engine.scene.gaussians import Gaussians

from .conftest import RandomGaussians

FILES = Path(__file__).resolve().parents[2] / "fixtures" / "formats"


def parts_of(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def write_parts(path: Path, parts: dict[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in parts.items():
            archive.writestr(name, data)


def changed(path: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """The file of PlayCanvas with another description."""
    parts = parts_of(FILES / "playcanvas.sog")
    meta = json.loads(parts["meta.json"])
    change(meta)
    write_parts(path, parts | {"meta.json": json.dumps(meta).encode()})
    return path


def in_order(gaussians: Gaussians) -> Gaussians:
    return gaussians[np.lexsort(gaussians.means.T)]


def test_a_file_of_splat_transform_is_read_as_it_reads_it() -> None:
    ours = read_sog(FILES / "playcanvas.sog", decode_picture, up="z")
    theirs = read_ply_file(FILES / "playcanvas.sog.ply").gaussians
    for name in ("means", "log_scales", "sh"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-6, err_msg=name)
    np.testing.assert_allclose(ours.opacities, theirs.opacities, atol=2e-6)
    np.testing.assert_allclose(rotations_from_quats(ours.quats), rotations_from_quats(theirs.quats), atol=1e-6)
    assert ours.sh_degree == 2 and not ours.antialiased


def test_a_file_that_is_not_zipped_is_read_from_its_folder(tmp_path: Path) -> None:
    for name, data in parts_of(FILES / "playcanvas.sog").items():
        (tmp_path / name).write_bytes(data)
    whole = read_sog(FILES / "playcanvas.sog", decode_picture)
    np.testing.assert_array_equal(read_sog(tmp_path / "meta.json", decode_picture).means, whole.means)
    (tmp_path / "sh0.webp").unlink()
    with pytest.raises(FormatError, match="sh0.webp cannot be read"):
        read_sog(tmp_path / "meta.json", decode_picture)


def test_version_1_has_ranges_instead_of_codebooks(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    steps = {name: rng.integers(0, 256, (2, 2, 4), np.uint8) for name in ("l", "u", "scales", "quats", "sh0", "labels")}
    steps["quats"][..., 3] = [[252, 253], [254, 255]]
    steps["labels"][..., :2] = [[[0, 0], [5, 0]], [[63, 0], [64, 0]]]
    steps["palette"] = rng.integers(0, 256, (2, 192, 4), np.uint8)
    meta = {
        "means": {"shape": [4, 3], "mins": [-1, -2, 0], "maxs": [1, 2, 1], "files": ["l.webp", "u.webp"]},
        "scales": {"mins": [-6, -5, -4], "maxs": [-1, -1, -1], "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"], "encoding": "quaternion_packed"},
        "sh0": {"mins": [-1, -1, -1, -4], "maxs": [2, 2, 2, 6], "files": ["sh0.webp"]},
        "shN": {"mins": -0.5, "maxs": 0.5, "files": ["palette.webp", "labels.webp"]},
    }
    pictures = {f"{name}.webp": encode_picture(pixels) for name, pixels in steps.items()}
    write_parts(tmp_path / "a.sog", {"meta.json": json.dumps(meta).encode(), **pictures})
    found = read_sog(tmp_path / "a.sog", decode_picture, up="z")
    flat = {name: pixels.reshape(-1, 4).astype(np.float64) for name, pixels in steps.items()}
    logs = np.array([-1, -2, 0]) + np.array([2, 4, 1]) * (flat["l"] + 256 * flat["u"])[:, :3] / 65535
    np.testing.assert_allclose(found.means, np.sign(logs) * (np.exp(np.abs(logs)) - 1), rtol=1e-6)
    expected = np.array([-6, -5, -4]) + np.array([5, 4, 3]) * flat["scales"][:, :3] / 255
    np.testing.assert_allclose(found.log_scales, expected, rtol=1e-6)
    np.testing.assert_allclose(found.sh[:, 0], -1 + 3 * flat["sh0"][:, :3] / 255, atol=1e-6)
    np.testing.assert_allclose(found.opacity_logits, -4 + 10 * flat["sh0"][:, 3] / 255, atol=1e-6)
    # Entry 64 is the first of the second row of the palette, which has three pixels for each entry.
    third = steps["palette"].astype(np.float64)[1, :3, :3] / 255 - 0.5
    np.testing.assert_allclose(found.sh[3, 1:], third, atol=1e-6)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_written_values_differ_by_what_the_format_rounds(
    tmp_path: Path, degree: int, random_gaussians: RandomGaussians
) -> None:
    gaussians = random_gaussians(1500, degree=degree)
    # Heights in steps that the format does not round away, by which both are put into the same order.
    gaussians.means[:, 2] = np.random.default_rng(1).permutation(np.linspace(-3, 3, 1500))
    write_sog(tmp_path / "a.sog", gaussians, encode_picture, FileFacts(extras={"title": "Ölkanne"}))
    back, gaussians = in_order(read_sog(tmp_path / "a.sog", decode_picture)), in_order(gaussians)
    # 16 bits of the logarithm of the distance from 0.
    np.testing.assert_allclose(back.means, gaussians.means, atol=1e-3 / 8)
    np.testing.assert_allclose(back.opacities, gaussians.opacities, atol=0.51 / 255)
    np.testing.assert_allclose(
        rotations_from_quats(back.quats), rotations_from_quats(gaussians.quats), atol=8 * 0.5 / 255
    )
    for name, values in (("log_scales", gaussians.log_scales), ("sh0", gaussians.sh[:, 0])):
        read = back.log_scales if name == "log_scales" else back.sh[:, 0]
        # 256 numbers for 4500 values of a normal distribution: their error is less than a hundredth of its width.
        assert np.sqrt(np.mean((read - values) ** 2)) < 0.01 * values.std(), name
    if degree:
        # 1024 of 1500 vectors without any likeness stand for all: a third for themselves, others for pairs.
        error = back.sh[:, 1:] - gaussians.sh[:, 1:]
        assert np.sqrt(np.mean(error**2)) < 0.6 * gaussians.sh[:, 1:].std()
        assert (np.abs(error).max(axis=(1, 2)) < 0.01).mean() > 0.3
    meta = json.loads(parts_of(tmp_path / "a.sog")["meta.json"])
    assert meta["extras"] == {"title": "Ölkanne"} and meta["count"] == 1500
    assert all(len(meta[part]["codebook"]) == 256 for part in ("scales", "sh0", *(["shN"] if degree else [])))


def test_a_small_file_is_written_the_same_again(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    for count in (1, 2, 17):
        for name in ("a.sog", "b.sog"):
            write_sog(tmp_path / name, random_gaussians(count, degree=1), encode_picture, FileFacts(up="z"))
        assert (tmp_path / "a.sog").read_bytes() == (tmp_path / "b.sog").read_bytes()
        back = read_sog(tmp_path / "a.sog", decode_picture, up="z")
        means = np.sort(random_gaussians(count, degree=1).means[:, 0])
        np.testing.assert_allclose(np.sort(back.means[:, 0]), means, atol=1e-3)


def test_anti_aliased_training_is_said_and_read_as_both_programs_say_it(
    tmp_path: Path, random_gaussians: RandomGaussians
) -> None:
    write_sog(tmp_path / "a.sog", replace(random_gaussians(5), antialiased=True), encode_picture)
    assert read_sog(tmp_path / "a.sog", decode_picture).antialiased
    for key, value in (("model", "antialiased"), ("antialias", True)):
        path = changed(tmp_path / f"{key}.sog", lambda meta, key=key, value=value: meta.update({key: value}))
        assert read_sog(path, decode_picture).antialiased, key


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda meta: meta.update(version=3), "is SOG 3; versions 1 and 2 are supported"),
        (lambda meta: meta.update(count=10**9), "has 1000000000 Gaussians"),
        (lambda meta: meta.update(count=5000), "pixels for 5000 Gaussians"),
        (lambda meta: meta.pop("quats"), "`quats` is missing"),
        (lambda meta: meta["means"].update(files=["means_l.webp"]), "names 1 pictures"),
        (lambda meta: meta["means"].update(mins=[0.0]), "does not have 3 ranges"),
        (lambda meta: meta["means"].update(maxs=[1e300] * 3), "not finite or too large"),
        (lambda meta: meta["scales"].update(codebook=[1.0]), "codebook of `scales` has 1 values"),
        (lambda meta: meta["quats"].update(files=["../quats.webp"]), "is missing in"),
        (lambda meta: meta["quats"].update(files=["meta.json"]), "neither WebP nor PNG"),
        (lambda meta: meta["shN"].update(bands=1), "for harmonics of degree 1"),
    ],
)
def test_damaged_files_are_refused_with_a_reason(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], said: str
) -> None:
    with pytest.raises(FormatError, match=said):
        read_sog(changed(tmp_path / "a.sog", change), decode_picture)


def test_a_picture_larger_than_its_gaussians_explain_is_not_decoded(tmp_path: Path) -> None:
    parts = parts_of(FILES / "playcanvas.sog")
    parts["scales.webp"] = encode_picture(np.zeros((3000, 3000, 4), np.uint8))
    write_parts(tmp_path / "a.sog", parts)

    def decode(data: bytes) -> Any:
        pixels = decode_picture(data)
        assert pixels.shape[0] < 3000
        return pixels

    with pytest.raises(FormatError, match="3000 x 3000 pixels, which are too many"):
        read_sog(tmp_path / "a.sog", decode)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04" + bytes(40), b"ply\n"])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.sog").write_bytes(content)
    with pytest.raises(FormatError, match=r"a\.sog"):
        read_sog(tmp_path / "a.sog", decode_picture)


def test_what_sog_cannot_hold_is_said(tmp_path: Path, random_gaussians: RandomGaussians) -> None:
    with pytest.raises(FormatError, match="would have 0 Gaussians"):
        write_sog(tmp_path / "a.sog", random_gaussians(2)[:0], encode_picture)
    broken = random_gaussians(3)
    broken.means[1, 0] = np.nan
    with pytest.raises(NumericalError, match="means"):
        write_sog(tmp_path / "a.sog", broken, encode_picture)
    matrix = np.eye(4)
    matrix[:3, 3] = (5e5, 4.5e6, 0)
    with pytest.raises(FormatError, match=r"around \(500000, 4500000, 0\).*Export PLY"):
        write_sog(tmp_path / "a.sog", random_gaussians(3), encode_picture, FileFacts(matrix=matrix))
    assert not list(tmp_path.iterdir())


def test_a_codebook_is_as_good_as_the_theory_says() -> None:
    values = np.random.default_rng(0).normal(size=20_000)
    book, numbers = codebook(values)
    # Panter and Dite: the error of N numbers for a normal distribution is sqrt(3) pi / 2 / N^2.
    assert np.mean((book[numbers] - values) ** 2) < 1.1 * 3**0.5 * np.pi / 2 / 256**2
    few, numbers = codebook(np.array([3.0, 1.0, 3.0]))
    assert few.tolist() == [1.0, 3.0] and numbers.tolist() == [1, 0, 1]


def test_a_palette_finds_the_groups_that_are_there() -> None:
    rng = np.random.default_rng(0)
    centers = rng.normal(size=(32, 9)).astype(np.float32)
    of = rng.integers(0, 32, 2000)
    entries, labels = palette((centers[of] + 1e-3 * rng.normal(size=(2000, 9))).astype(np.float32), 64)
    np.testing.assert_allclose(entries[labels], centers[of], atol=0.02)
    same, labels = palette(np.ones((10, 3), np.float32), 4)
    assert len(same) == 1 and not labels.any()


def test_decoding_and_encoding_keep_every_bit_and_refuse_other_pictures() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (5, 7, 4), np.uint8)
    np.testing.assert_array_equal(decode_picture(encode_picture(pixels)), pixels)
    for data in (b"", b"RIFF", encode_picture(pixels)[:40], io.BytesIO(b"GIF89a").read()):
        with pytest.raises(ValueError):
            decode_picture(data)
