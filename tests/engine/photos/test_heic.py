"""HEIC, the format of phones, is read like any other photo. The files are encoded here."""

from __future__ import annotations

import io
import struct
import sys
from pathlib import Path

import numpy as np
import pillow_heif
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageCms

from engine.core.errors import PhotoError
from engine.photos.capture_facts import exif_facts
from engine.photos.heic import can_read_heic
from engine.photos.loading import load_pixels, load_with_valid
from engine.photos.pixels import open_photo
from engine.photos.reading import read_photos
from engine.photos.settings import PhotoSettings

from .test_pixels import EXIF_IFD, ORIENTATION, corners
from .test_reading import SMALL, names, save, textured

can_read_heic()
_P3 = np.array([[0.4865709, 0.2656677, 0.1982173], [0.2289746, 0.6917385, 0.0792869], [0.0, 0.0451134, 1.0439444]])
_SRGB = np.array(
    [[0.4123908, 0.3575843, 0.1804808], [0.2126390, 0.7151687, 0.0721923], [0.0193308, 0.1191948, 0.9505322]]
)
"""Light of both to XYZ, as their standards state them."""


def write_heic(path: Path, pixels: NDArray[np.uint8], **options: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, format="HEIF", quality=95, chroma=444, **options)


def in_p3(srgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the same colours as a camera stores them in Display P3."""
    levels = srgb / 255.0
    light = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    light = np.clip(light @ (np.linalg.inv(_P3) @ _SRGB).T, 0.0, 1.0)
    return np.rint(255.0 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)).astype(
        np.uint8
    )


def p3_profile() -> bytes:
    """Return a colour profile of Display P3, written from its definition (ICC.1, matrix and curve)."""
    to_d50 = np.array(
        [[1.0478112, 0.0228866, -0.0501270], [0.0295424, 0.9904844, -0.0170491], [-0.0092345, 0.0150436, 0.7521316]]
    )
    levels = np.arange(1024) / 1023.0
    light = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)

    def fixed(numbers: object) -> bytes:
        return b"XYZ \0\0\0\0" + b"".join(struct.pack(">i", round(65536 * value)) for value in numbers)  # type: ignore[attr-defined]

    curve = b"curv\0\0\0\0" + struct.pack(">I", 1024) + np.rint(65535 * light).astype(">u2").tobytes()
    name = b"Display P3\0"
    text = b"desc\0\0\0\0" + struct.pack(">I", len(name)) + name + bytes(78)
    red, green, blue = (to_d50 @ _P3).T
    tags = [(b"desc", text), (b"cprt", b"text\0\0\0\0CC0\0"), (b"wtpt", fixed((0.9642, 1.0, 0.8249)))]
    tags += [(b"rXYZ", fixed(red)), (b"gXYZ", fixed(green)), (b"bXYZ", fixed(blue))]
    tags += [(key, curve) for key in (b"rTRC", b"gTRC", b"bTRC")]
    at, table, body = 128 + 4 + 12 * len(tags), b"", b""
    for key, data in tags:
        padded = data + bytes(-len(data) % 4)
        table += key + struct.pack(">II", at + len(body), len(data))
        body += padded
    head = struct.pack(">I4sI4s4s4s", at + len(body), b"\0\0\0\0", 0x02400000, b"mntr", b"RGB ", b"XYZ ")
    head += struct.pack(">6H", 2026, 1, 1, 0, 0, 0) + b"acsp" + bytes(28) + fixed((0.9642, 1.0, 0.8249))[8:] + bytes(48)
    return head + struct.pack(">I", len(tags)) + table + body


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_rotated_heic_photo_is_upright(tmp_path: Path, orientation: int) -> None:
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    for name in ("a.heic", "a.jpg"):
        options = {"format": "HEIF", "chroma": 444} if name == "a.heic" else {"subsampling": 0}
        Image.fromarray(corners()).save(tmp_path / name, quality=95, exif=exif.tobytes(), **options)
    heic, jpeg = load_pixels(tmp_path / "a.heic"), load_pixels(tmp_path / "a.jpg")
    assert heic.shape == jpeg.shape
    assert np.abs(heic.astype(int) - jpeg).mean() < 3
    # Of the two copies of a shot one is used.
    (tmp_path / "a.jpg").unlink()
    photo = read_photos(tmp_path, PhotoSettings(min_side=16)).photos[0]
    assert (photo.name, photo.height, photo.width) == ("a.heic", *jpeg.shape[:2])
    reduced = load_pixels(tmp_path / "a.heic", max_side=32)
    assert max(reduced.shape) == 32


def test_exif_of_a_heic_photo_is_used(tmp_path: Path) -> None:
    picture = Image.fromarray(corners(300, 400))
    exif = picture.getexif()
    exif[0x010F], exif[ORIENTATION] = "Apple", 6
    exif.get_ifd(EXIF_IFD).update({0xA405: 26, 0x9003: "2026:05:01 10:20:30"})
    picture.save(tmp_path / "a.heic", format="HEIF", exif=exif.tobytes())
    focal = read_photos(tmp_path).photos[0].focal_px
    assert focal == pytest.approx(26 * np.hypot(400, 300) / np.hypot(36, 24), rel=1e-4)
    facts = exif_facts(tmp_path / "a.heic")
    assert (facts["camera_make"], facts["taken"]) == ("Apple", "2026-05-01T10:20:30")


@pytest.mark.parametrize("suffix", ["heic", "jpg", "png", "tif", "webp"])
def test_display_p3_becomes_srgb_in_every_format(tmp_path: Path, suffix: str) -> None:
    expected = corners()
    path = tmp_path / f"a.{suffix}"
    profile = p3_profile()
    assert "P3" in ImageCms.getProfileDescription(ImageCms.ImageCmsProfile(io.BytesIO(profile)))
    options = {
        "jpg": {"quality": 98, "subsampling": 0},
        "webp": {"lossless": True},
        "heic": {"quality": 98, "chroma": 444},
    }
    Image.fromarray(in_p3(expected)).save(
        path, format="HEIF" if suffix == "heic" else None, icc_profile=profile, **options.get(suffix, {})
    )
    # Codecs and 8 bits give up to 6 levels in single pixels; without the conversion the mean of red is off by 15.
    assert np.abs(load_pixels(path).astype(int) - expected).mean() < 2


def test_display_p3_that_is_stated_by_numbers_becomes_srgb(tmp_path: Path) -> None:
    expected = corners()
    write_heic(
        tmp_path / "a.heic", in_p3(expected), color_primaries=12, transfer_characteristics=13, matrix_coefficients=6
    )
    with Image.open(tmp_path / "a.heic") as opened:
        assert "icc_profile" not in opened.info
    assert np.abs(load_pixels(tmp_path / "a.heic").astype(int) - expected).mean() < 2


def test_a_photo_for_hdr_screens_is_refused_with_its_cause(tmp_path: Path) -> None:
    write_heic(tmp_path / "a.heic", corners(), color_primaries=9, transfer_characteristics=16, matrix_coefficients=9)
    with pytest.raises(PhotoError, match=r"^a\.heic stores brightness for HDR screens \(PQ\).* Switch HDR off"):
        load_pixels(tmp_path / "a.heic")


def test_ten_bits_and_tiles_are_read(tmp_path: Path) -> None:
    pixels = textured(1, height=128, width=192)
    wide = pixels.astype(np.uint16) * 257
    source = pillow_heif.from_bytes(mode="RGB;16", size=(192, 128), data=wide.tobytes())
    source.save(tmp_path / "a.heic", quality=95, chroma=444, tile_size=64)
    with Image.open(tmp_path / "a.heic") as opened:
        assert opened.info["bit_depth"] == 10 and opened.info["tiling"]["num_columns"] == 3
    assert np.abs(load_pixels(tmp_path / "a.heic").astype(int) - pixels).mean() < 3


def test_the_primary_picture_of_a_burst_is_the_photo(tmp_path: Path) -> None:
    pictures = [Image.fromarray(textured(seed)) for seed in range(3)]
    pictures[0].save(
        tmp_path / "a.heic", format="HEIF", save_all=True, append_images=pictures[1:], primary_index=2, quality=95
    )
    loaded = load_pixels(tmp_path / "a.heic").astype(int)
    assert [np.abs(loaded - textured(seed)).mean() < 10 for seed in range(3)] == [False, False, True]


def test_a_thumbnail_never_stands_for_the_photo(tmp_path: Path) -> None:
    write_heic(tmp_path / "a.heic", corners(600, 800), thumbnails=[200])
    assert open_photo(tmp_path / "a.heic", max_side=100)[0].size == (800, 600)
    Image.new("L", (800, 600), 255).save(tmp_path / "m.png")
    assert load_with_valid(tmp_path / "a.heic", tmp_path / "m.png", max_side=100)[0].shape == (75, 100, 3)


def test_transparent_heic_is_composited_over_white(tmp_path: Path) -> None:
    pixels = np.dstack([corners(), np.full((48, 64), 255, np.uint8)])
    pixels[:, 32:, 3] = 0
    write_heic(tmp_path / "a.heic", pixels)
    loaded = load_pixels(tmp_path / "a.heic").astype(int)
    assert np.abs(loaded[:, 40:] - 255).max() < 6
    assert np.abs(loaded[4, 16] - [250, 10, 10]).max() < 12


def test_a_heic_mask_excludes_its_black_pixels(tmp_path: Path) -> None:
    save(tmp_path / "photos" / "a.png", textured(0))
    mask = np.zeros((48, 64), np.uint8)
    mask[:, 32:] = 255
    (tmp_path / "masks").mkdir()
    Image.fromarray(mask).save(tmp_path / "m.heic", format="HEIF", quality=-1, chroma=444)
    (tmp_path / "m.heic").rename(tmp_path / "masks" / "a.png.png")
    found = read_photos(tmp_path / "photos", SMALL, masks=tmp_path / "masks")
    _, valid = load_with_valid(tmp_path / "photos" / "a.png", found.mask_files["a.png"])
    assert valid is not None and (valid == (mask > 0)).mean() > 0.95


@pytest.mark.parametrize("n_bytes", [40, 400, 3000])
def test_a_heic_file_that_is_cut_short_rejects_itself_only(tmp_path: Path, n_bytes: int) -> None:
    save(tmp_path / "good.png", textured(0))
    write_heic(tmp_path / "cut.heic", textured(9, height=200, width=300))
    (tmp_path / "cut.heic").write_bytes((tmp_path / "cut.heic").read_bytes()[:n_bytes])
    used, rejected = names(tmp_path)
    assert used == ["good.png"]
    assert "damaged or cut short" in rejected["cut.heic"]


def test_a_large_heic_photo_is_decoded_in_a_child_within_its_bounds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_heic(tmp_path / "a.heic", textured(0))
    here = load_pixels(tmp_path / "a.heic")
    monkeypatch.setattr("engine.photos.loading.is_large", lambda *headers: True)
    assert (load_pixels(tmp_path / "a.heic") == here).all()


def test_an_environment_without_the_reader_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(tmp_path / "a.png", textured(0))
    write_heic(tmp_path / "b.heic", textured(1))
    monkeypatch.setattr("engine.photos.heic._is_registered", False)
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    used, rejected = names(tmp_path)
    assert used == ["a.png"]
    assert rejected["b.heic"].startswith("It is a HEIC file, and the package pillow-heif")
    assert rejected["b.heic"].endswith("Set up the engine again, or save the photo as JPEG.")
