"""EXIF values of any type and size are used or ignored; none stops a photo."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.photos.exif import without_pillow_warnings
from engine.photos.inspection import inspect_photos
from engine.photos.reading import read_photos

from .hostile import chunk, png_with
from .test_reading import SMALL, textured

CAMERA_TAGS = (0x829A, 0x829D, 0x8827, 0x920A, 0xA405, 0xA002, 0xA003, 0xA20E, 0xA210)
ORIENTATION, EXIF_IFD = 0x0112, 0x8769

VALUES = {
    "double": (12, b"".join(struct.pack("<d", value) for value in (1e200, 1e200))),
    "infinite": (12, struct.pack("<d", float("inf"))),
    "not a number": (12, struct.pack("<d", float("nan"))),
    "denormal": (12, struct.pack("<d", 5e-324)),
    "negative": (12, struct.pack("<d", -1e308)),
    "0/0": (5, struct.pack("<LL", 0, 0)),
    "1/0": (5, struct.pack("<LL", 1, 0)),
    "largest ratio": (5, struct.pack("<LL", 0xFFFFFFFF, 1)),
    "large integer": (16, struct.pack("<Q", 2**64 - 1)),
    "text": (2, b"1e400\0"),
    "long text": (2, b"9" * 400 + b"\0"),
    "bytes": (7, b"\xff\xfe\0\x1b"),
    "nothing": (3, b""),
    "many": (3, bytes(200)),
}
SIZES = {2: 1, 3: 2, 5: 8, 7: 1, 12: 8, 16: 8}


def directory(entries: list[tuple[int, int, bytes]], place: int) -> bytes:
    """Return a TIFF directory that begins at byte `place` of its file."""
    packed, data = struct.pack("<H", len(entries)), b""
    after = place + 2 + 12 * len(entries) + 4
    for tag, kind, value in entries:
        count = len(value) // SIZES.get(kind, 4)
        if len(value) > 4:
            field, data = struct.pack("<L", after + len(data)), data + value
        else:
            field = value.ljust(4, b"\0")
        packed += struct.pack("<HHL", tag, kind, count) + field
    return packed + struct.pack("<L", 0) + data


def exif(kind: int, value: bytes) -> bytes:
    """Return EXIF in which the orientation and every value about the camera is `value`."""
    first = directory([(ORIENTATION, kind, value), (EXIF_IFD, 4, struct.pack("<L", 1000))], 8)
    return (b"II*\0" + struct.pack("<L", 8) + first).ljust(1000, b"\0") + directory(
        [(tag, kind, value) for tag in CAMERA_TAGS], 1000
    )


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp"])
@pytest.mark.parametrize("value", VALUES)
def test_any_exif_value_is_used_or_ignored(tmp_path: Path, value: str, suffix: str) -> None:
    data = exif(*VALUES[value])
    Image.fromarray(textured(0)).save(tmp_path / f"a.{suffix}", exif=data if suffix == "png" else b"Exif\0\0" + data)
    found = read_photos(tmp_path, SMALL)
    assert [photo.name for photo in found.photos] == [f"a.{suffix}"]
    (statistics,) = inspect_photos(found)
    assert statistics.texture > 0
    assert found.photos[0].focal_px is None or np.isfinite(found.photos[0].focal_px)


def test_focal_length_that_overflows_is_ignored(tmp_path: Path) -> None:
    camera = [(0x920A, 12, struct.pack("<d", 1e200)), (0xA20E, 12, struct.pack("<d", 1e200))]
    first = directory([(EXIF_IFD, 4, struct.pack("<L", 100))], 8)
    data = (b"II*\0" + struct.pack("<L", 8) + first).ljust(100, b"\0")
    data += directory([*camera, (0xA210, 3, struct.pack("<H", 3))], 100)
    Image.fromarray(textured(0)).save(tmp_path / "a.png", exif=data)
    assert read_photos(tmp_path, SMALL).photos[0].focal_px is None


def test_megabytes_of_exif_are_ignored(tmp_path: Path) -> None:
    n = 140_000
    tag = struct.pack("<H", 1) + struct.pack("<HHLL", 0x829D, 5, n, 44) + struct.pack("<L", 0)
    data = b"II*\0" + struct.pack("<LHHHLLL", 8, 1, EXIF_IFD, 4, 1, 26, 0) + tag + struct.pack("<LL", 4, 1) * n
    (tmp_path / "a.png").write_bytes(png_with(chunk(b"eXIf", data)))
    Image.fromarray(textured(0)).save(tmp_path / "b.png")
    found = read_photos(tmp_path, SMALL)
    assert [photo.reason for photo in found.rejected] == ["It is black; was the lens cap on?"]


def test_other_warnings_are_still_shown_while_photos_are_read() -> None:
    with without_pillow_warnings(), pytest.warns(UserWarning, match="ours"):
        warnings.warn("ours", stacklevel=1)
