"""Pictures of all formats are loaded as upright, 8-bit, three-channel sRGB pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageCms

from engine.core.errors import PhotoError
from engine.photos.exif import UPRIGHT_TRANSPOSES
from engine.photos.loading import load_pixels
from engine.photos.reading import read_photos
from engine.photos.settings import PhotoSettings

from .opencv import write_picture

ORIENTATION, EXIF_IFD = 0x0112, 0x8769


def corners(height: int = 48, width: int = 64) -> NDArray[np.uint8]:
    """Return a picture whose four quarters differ, so that every rotation and reflection changes it."""
    pixels = np.zeros((height, width, 3), np.uint8)
    pixels[: height // 2, : width // 2] = (250, 10, 10)
    pixels[: height // 2, width // 2 :] = (10, 250, 10)
    pixels[height // 2 :, : width // 2] = (10, 10, 250)
    pixels[height // 2 :, width // 2 :] = (240, 240, 20)
    return pixels


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif", "webp"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_is_applied(tmp_path: Path, suffix: str, orientation: int) -> None:
    upright = corners()
    undo = {6: 8, 8: 6}.get(orientation, orientation)
    stored = Image.fromarray(upright)
    if orientation > 1:
        stored = stored.transpose(UPRIGHT_TRANSPOSES[undo])
    exif = stored.getexif()
    exif[ORIENTATION] = orientation
    path = tmp_path / f"a.{suffix}"
    stored.save(path, exif=exif, **({"quality": 95, "subsampling": 0} if suffix == "jpg" else {}))
    pixels = load_pixels(path)
    assert pixels.shape == upright.shape
    for row, column in ((10, 10), (10, 50), (40, 10), (40, 50)):
        assert np.abs(pixels[row, column].astype(int) - upright[row, column]).max() < 12
    photo = read_photos(tmp_path, PhotoSettings(min_side=16)).photos[0]
    assert (photo.width, photo.height) == (64, 48)
    small = load_pixels(path, max_side=32)
    assert small.shape == (24, 32, 3)
    assert np.abs(small[5, 5].astype(int) - upright[10, 10]).max() < 12


def test_sixteen_bits_are_rounded_to_eight(tmp_path: Path) -> None:
    ramp = np.linspace(0, 65535, 64 * 48).reshape(48, 64).astype(np.uint16)
    for suffix in ("png", "tif"):
        path = tmp_path / f"gray.{suffix}"
        write_picture(path, ramp)
        pixels = load_pixels(path)
        assert pixels.dtype == np.uint8
        assert np.abs(pixels[..., 0] - ramp / 257.0).max() <= 0.5
        assert (pixels == pixels[..., :1]).all()
        path = tmp_path / f"colour.{suffix}"
        write_picture(path, np.stack([ramp, ramp // 2, ramp // 3], axis=-1))
        pixels = load_pixels(path)
        # Pillow keeps the upper byte of 16-bit colour: at most one level below the rounded value.
        assert np.abs(pixels - np.stack([ramp // 3, ramp // 2, ramp], axis=-1) / 257.0).max() <= 1.0


@pytest.mark.parametrize("mode", ["L", "P", "1", "LA", "RGBA", "PA"])
def test_gray_palette_and_alpha_become_three_channels(tmp_path: Path, mode: str) -> None:
    picture = Image.fromarray(corners())
    picture = picture.convert("RGBA").convert(mode) if mode in ("LA", "PA") else picture.convert(mode)
    path = tmp_path / ("a.tif" if mode == "PA" else "a.png")
    try:
        picture.save(path)
    except OSError:
        pytest.skip(f"Pillow cannot write {mode}")
    pixels = load_pixels(path)
    assert pixels.shape == (48, 64, 3)
    assert pixels.std() > 10


def test_transparent_pixels_are_composited_over_white(tmp_path: Path) -> None:
    pixels = np.dstack([corners(), np.full((48, 64), 255, np.uint8)])
    pixels[:, 32:, 3] = 0
    pixels[:, :8, 3] = 128
    Image.fromarray(pixels).save(tmp_path / "a.png")
    loaded = load_pixels(tmp_path / "a.png")
    assert (loaded[:, 32:] == 255).all()
    assert loaded[4, 16].tolist() == [250, 10, 10]
    assert np.abs(loaded[4, 4].astype(int) - [252, 132, 132]).max() <= 1


def test_cmyk_is_converted(tmp_path: Path) -> None:
    Image.fromarray(corners()).convert("CMYK").save(tmp_path / "a.jpg", quality=95)
    assert np.abs(load_pixels(tmp_path / "a.jpg")[10, 10].astype(int) - [250, 10, 10]).max() < 15


def test_a_colour_profile_is_converted_to_srgb(tmp_path: Path) -> None:
    lab = ImageCms.createProfile("LAB")
    srgb = ImageCms.createProfile("sRGB")
    expected = corners()
    transform = ImageCms.buildTransform(srgb, lab, "RGB", "LAB")
    stored = ImageCms.applyTransform(Image.fromarray(expected), transform)
    assert stored is not None
    stored.save(tmp_path / "a.tif", icc_profile=ImageCms.ImageCmsProfile(lab).tobytes())
    # LAB in 8 bits is coarse in saturated colours (worst seen: 18); read as if it were RGB it would be off by 200.
    assert np.abs(load_pixels(tmp_path / "a.tif").astype(int) - expected).max() < 20


def test_a_damaged_colour_profile_is_ignored(tmp_path: Path) -> None:
    Image.fromarray(corners()).save(tmp_path / "a.png", icc_profile=b"nonsense" * 20)
    assert (load_pixels(tmp_path / "a.png") == corners()).all()


@pytest.mark.parametrize("size", [(729, 1093), (1001, 333), (640, 480)])
def test_a_reduced_picture_shows_the_same_positions(tmp_path: Path, size: tuple[int, int]) -> None:
    width, height = size
    x = np.linspace(0, 255, width)[None, :, None].repeat(height, 0)
    y = np.linspace(0, 255, height)[:, None, None].repeat(width, 1)
    Image.fromarray(np.rint(np.concatenate([x, y, 0 * x], axis=2)).astype(np.uint8)).save(
        tmp_path / "a.jpg", quality=98, subsampling=0
    )
    full = load_pixels(tmp_path / "a.jpg")
    assert full.shape[:2] == (height, width)
    small = load_pixels(tmp_path / "a.jpg", max_side=150)
    assert max(small.shape) == 150
    # The half-size JPEG decoding of an odd side must not shift or stretch it: a pixel of the photo is 255 / width
    # levels of the ramp; one at the far end is allowed, for rounded levels.
    for axis, length in ((1, width), (0, height)):
        count = small.shape[axis]
        ramp = small[..., 1 - axis].mean(axis=1 - axis)
        slope, start = np.polyfit((np.arange(2, count - 2) + 0.5) / count, ramp[2:-2], 1)
        pixel = 255 / (length - 1)
        assert start == pytest.approx(-0.5 * pixel, abs=pixel)
        assert slope + start == pytest.approx(255 + 0.5 * pixel, abs=pixel)
    assert load_pixels(tmp_path / "a.jpg", max_side=5000).shape == full.shape


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({0xA405: 35}, 35 * np.hypot(400, 300) / np.hypot(36, 24)),
        ({0xA405: 0, 0x920A: 50.0, 0xA20E: 3000 / 3.6, 0xA210: 3, 0xA002: 3000}, 50.0 * 3000 / 36.0 * 400 / 3000),
        ({0x920A: 25.4, 0xA20E: 400.0, 0xA210: 2}, 400.0),
        ({0x920A: 50.0}, None),
        ({0xA405: 35000}, None),
        ({}, None),
    ],
    ids=["35 mm", "focal plane", "inch", "no sensor", "absurd", "nothing"],
)
@pytest.mark.parametrize("orientation", [1, 6])
def test_focal_length_in_pixels_comes_from_exif(
    tmp_path: Path, tags: dict[int, float], expected: float | None, orientation: int
) -> None:
    picture = Image.fromarray(corners(300, 400))
    exif = picture.getexif()
    exif[ORIENTATION] = orientation
    exif.get_ifd(EXIF_IFD).update(tags)
    picture.save(tmp_path / "a.jpg", exif=exif)
    focal = read_photos(tmp_path).photos[0].focal_px
    assert focal == (pytest.approx(expected, rel=1e-4) if expected is not None else None)


def test_photo_with_damaged_exif_is_used(tmp_path: Path) -> None:
    Image.fromarray(corners(300, 400)).save(tmp_path / "a.jpg", exif=b"Exif\0\0II*\0\x08\0\0\0\xff\xff\x01\x02\x03")
    photo = read_photos(tmp_path).photos[0]
    assert photo.focal_px is None


def test_a_missing_photo_is_named() -> None:
    with pytest.raises(PhotoError, match="gone.jpg is missing"):
        load_pixels(Path("gone.jpg"))


def test_format_whose_decoder_takes_much_memory_has_a_smaller_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("engine.photos.pixels._MAX_PIXELS_OF_FORMAT", {"WEBP": 2_000_000})
    picture = Image.new("RGB", (2000, 1001))
    picture.save(tmp_path / "a.jpg")
    picture.save(tmp_path / "a.webp")
    assert load_pixels(tmp_path / "a.jpg").shape == (1001, 2000, 3)
    with pytest.raises(PhotoError, match="at most 2 million pixels .* Save it in another format than WEBP"):
        load_pixels(tmp_path / "a.webp")
