"""HEIC photos that FFmpeg decodes have libheif's pixels; what it must not decide is left to libheif."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pillow_heif
import pytest
from numpy.typing import NDArray
from PIL import Image

from engine.core.errors import PhotoError
from engine.photos.heic import can_read_heic
from engine.photos.heic_tiles import load_heic
from engine.photos.loading import load_pixels
from engine.photos.pixels import open_photo

from .test_pixels import ORIENTATION

can_read_heic()


def scene(height: int = 150, width: int = 230) -> NDArray[np.uint8]:
    """Return a picture whose every place looks different: soft hills of colour with some noise."""
    rng = np.random.default_rng(5)
    hills = Image.fromarray(rng.integers(0, 255, (6, 9, 3)).astype(np.uint8)).resize((width, height), 3)
    return np.clip(np.asarray(hills) + rng.normal(0, 3, (height, width, 3)), 0, 255).astype(np.uint8)


def write(path: Path, pixels: NDArray[np.uint8], **options: object) -> Path:
    Image.fromarray(pixels).save(path, format="HEIF", **options)
    return path


def by_libheif(path: Path) -> NDArray[np.int64]:
    with Image.open(path) as image:
        return np.asarray(image).astype(int)


def by_ffmpeg(path: Path) -> NDArray[np.int64] | None:
    """Return the pixels of a file; None when libheif decoded them."""
    with Image.open(path) as opened:
        loaded = load_heic(opened)
        return None if loaded is opened else np.asarray(loaded.convert("RGB")).astype(int)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("tile_size", [0, 64])
def test_pixels_are_those_of_libheif(tmp_path: Path, orientation: int, tile_size: int) -> None:
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    path = write(tmp_path / "a.heic", scene(), exif=exif.tobytes(), tile_size=tile_size, thumbnails=[64])
    pixels = by_ffmpeg(path)
    assert pixels is not None
    # Both round the same sum of three products, one of them in other fixed-point numbers.
    assert np.abs(pixels - by_libheif(path)).max() <= 1
    photo = open_photo(path)[0]
    assert photo.format == "HEIF" and "original_orientation" in photo.info


@pytest.mark.parametrize("quality", [10, 40, 95])
def test_tiles_of_every_quality_fit_together(tmp_path: Path, quality: int) -> None:
    path = write(tmp_path / "a.heic", scene(600, 800), quality=quality, tile_size=256)
    pixels = by_ffmpeg(path)
    assert pixels is not None
    assert np.abs(pixels - by_libheif(path)).max() <= 1


@pytest.mark.parametrize("matrix", [2, 5, 6])
def test_colours_without_a_stated_matrix_are_those_of_jpeg(tmp_path: Path, matrix: int) -> None:
    path = write(tmp_path / "a.heic", scene(), matrix_coefficients=matrix, tile_size=64)
    pixels = by_ffmpeg(path)
    assert pixels is not None
    assert np.abs(pixels - by_libheif(path)).max() <= 1


@pytest.mark.parametrize(
    "options",
    [{"chroma": 444}, {"chroma": 422}, {"full_range_flag": 0}, {"matrix_coefficients": 1}, {"color": "alpha"}],
    ids=str,
)
def test_other_forms_are_left_to_libheif(tmp_path: Path, options: dict[str, object]) -> None:
    pixels = scene()
    if options.pop("color", None):
        pixels = np.dstack([pixels, np.full(pixels.shape[:2], 200, np.uint8)])
    path = write(tmp_path / "a.heic", pixels, **options)
    assert by_ffmpeg(path) is None


def test_ten_bits_and_bursts_are_left_to_libheif(tmp_path: Path) -> None:
    wide = scene().astype(np.uint16) * 257
    source = pillow_heif.from_bytes(mode="RGB;16", size=(230, 150), data=wide.tobytes())
    source.save(tmp_path / "deep.heic", tile_size=64)
    assert by_ffmpeg(tmp_path / "deep.heic") is None
    others = [Image.fromarray(scene()[::-1])]
    write(tmp_path / "burst.heic", scene(), save_all=True, append_images=others, primary_index=1, tile_size=64)
    assert by_ffmpeg(tmp_path / "burst.heic") is None


@pytest.mark.parametrize("exchanged", [(0, 1), (0, 5), (2, 7)])
def test_tiles_that_are_numbered_in_another_order_stand_at_their_places(
    tmp_path: Path, exchanged: tuple[int, int]
) -> None:
    pixels = scene(128, 256)
    one, other = (pixels[place // 4 * 64 :, place % 4 * 64 :][:64, :64] for place in exchanged)
    one[:], other[:] = other.copy(), one.copy()
    path = write(tmp_path / "a.heic", pixels, tile_size=64)
    data = bytearray(path.read_bytes())
    # Behind the name of the list: the number of the picture, the count of its tiles, and their numbers.
    numbers = data.index(b"dimg") + 8
    first, second = (slice(numbers + 2 * place, numbers + 2 * place + 2) for place in exchanged)
    data[first], data[second] = data[second], data[first]
    path.write_bytes(data)
    assert np.abs(by_libheif(path) - scene(128, 256)).mean() < 4
    assert (load_pixels(path) == by_libheif(path)).all()


@pytest.mark.parametrize("tile_size", [0, 64])
def test_every_file_that_is_cut_short_is_refused(tmp_path: Path, tile_size: int) -> None:
    path = write(tmp_path / "a.heic", scene(), tile_size=tile_size)
    data = path.read_bytes()
    for share in (0.3, 0.6, 0.9, 0.99):
        path.write_bytes(data[: int(share * len(data))])
        with pytest.raises(PhotoError, match=r"^a\.heic is .*damaged or cut short"):
            load_pixels(path)


def test_without_ffmpeg_the_pixels_are_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "a.heic", scene(), tile_size=64)
    with_ffmpeg = load_pixels(path).astype(int)
    monkeypatch.setitem(sys.modules, "av", None)
    assert by_ffmpeg(path) is None
    assert np.abs(load_pixels(path) - with_ffmpeg).max() <= 1
