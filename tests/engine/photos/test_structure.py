"""Small files that would keep a parser busy for minutes are rejected before it runs."""

from __future__ import annotations

import io
import mmap
import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from engine.core.errors import PhotoError
from engine.photos import load_pixels
from engine.photos.pixels import open_photo, read_header

from .hostile import chunk, png_with, tiff
from .test_reading import textured


def jpeg(**options: object) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(textured(0)).save(stream, "JPEG", **options)  # type: ignore[arg-type]
    return stream.getvalue()


def segment(content: bytes) -> bytes:
    return b"\xff\xe1" + struct.pack(">H", len(content) + 2) + content


def many_scans() -> bytes:
    data = jpeg(progressive=True)
    last = data[data.rfind(b"\xff\xda") : -2]
    return data[:-2] + 300 * last + data[-2:]


def many_profiles() -> bytes:
    return png_with(50 * chunk(b"iCCP", b"a\0\0" + zlib.compress(bytes(1_000_000))))


HOSTILE: dict[str, tuple[Callable[[], bytes], str]] = {
    "scans.jpg": (many_scans, "has an unusual number of scans"),
    "segments.jpg": (
        lambda: jpeg()[:2] + 6_000 * segment(b"x") + jpeg()[2:],
        "has more than 5,000 segments before its picture",
    ),
    "exif.jpg": (
        lambda: jpeg()[:2] + 20 * segment(b"Exif\0\0" + bytes(60_000)) + jpeg()[2:],
        "has more than 1 MB of EXIF data",
    ),
    "profiles.png": (many_profiles, "has an unusual number of chunks beside its picture"),
    "chunks.png": (
        lambda: png_with(2_000 * chunk(b"teSt", b"")),
        "has an unusual number of chunks beside its picture",
    ),
    "data.png": (lambda: png_with(2_000 * chunk(b"IDAT", b"")), "is divided into unusually small chunks"),
    "tags.tif": (lambda: tiff([(tag, 3, 1, 0) for tag in range(5_000)]), "has more than 4,096 tags"),
    "strips.tif": (
        lambda: tiff([(256, 3, 1, 200), (257, 4, 1, 200), (273, 4, 1_000_000, 8)]),
        "is divided into more than 100,000 parts",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_file_that_would_keep_a_parser_busy_is_rejected(tmp_path: Path, name: str) -> None:
    make, problem = HOSTILE[name]
    (tmp_path / name).write_bytes(make())
    with pytest.raises(PhotoError, match=f"^{name} {problem}. Save it again as JPEG, PNG or TIFF.$"):
        read_header(tmp_path / name)


def test_usual_structures_are_read(tmp_path: Path) -> None:
    picture = Image.fromarray(np.random.default_rng(0).integers(0, 255, (900, 1200, 3), dtype=np.uint8))
    profile = segment(b"ICC_PROFILE\0" + bytes(60_000))
    (tmp_path / "a.jpg").write_bytes(jpeg(progressive=True)[:2] + 10 * profile + jpeg(progressive=True)[2:])
    picture.save(tmp_path / "a.png")
    picture.save(tmp_path / "a.tif", tiffinfo={278: 1})
    picture.save(tmp_path / "b.tif", big_tiff=True)
    picture.save(tmp_path / "a.webp")
    for path in tmp_path.iterdir():
        assert open_photo(path)[0].width >= 64


def test_plug_in_that_starts_another_program_is_not_tried(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 200 200\n%%EndComments\nshowpage\n")
    with pytest.raises(PhotoError, match=r"a\.png is not a picture that can be read"):
        open_photo(tmp_path / "a.png")


def test_jpeg_without_exif_is_read_where_mapping_a_file_moves_its_position(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """CPython's mmap does so on Windows; pictures of messengers have no EXIF."""
    real = mmap.mmap

    def as_on_windows(number: int, *arguments: Any, **named: Any) -> mmap.mmap:
        os.lseek(number, 0, os.SEEK_SET)
        return real(number, *arguments, **named)

    monkeypatch.setattr(mmap, "mmap", as_on_windows)
    rng = np.random.default_rng(0)
    Image.fromarray(rng.integers(0, 256, (300, 400, 3), np.uint8)).save(tmp_path / "a.jpg", quality=95)
    assert load_pixels(tmp_path / "a.jpg").shape == (300, 400, 3)
