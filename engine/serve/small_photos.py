"""Small JPEG copies of photos for the browser, upright."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FormatError
from ..core.files import write_file

SMALL_SIDE = 320
"""Pixels of the longest side in lists."""
LARGE_SIDE = 1600
"""Pixels of the longest side where a photo is looked at."""
_SIDES = (SMALL_SIDE, LARGE_SIDE)
"""Sizes that are kept; other ones are rounded up, so that a client cannot fill the disk."""
_QUALITY = 88


def small_photo(photo: Path, cache: Path, side: int) -> Path:
    """Return a JPEG of `photo` whose longest side is at least `side` pixels, or the largest size that is kept.

    Raises
    ------
    PhotoError
        When the photo cannot be read.
    """
    file = kept_small_photo(photo, cache, side)
    if file is None:
        kept = _kept_side(side)
        file = _copy_of(photo, cache, kept)
        write_small_photo(photo, file, side=kept)
    return file


def kept_small_photo(photo: Path, cache: Path, side: int) -> Path | None:
    """Return the file of `small_photo` where it has been made already."""
    file = _copy_of(photo, cache, _kept_side(side))
    is_new = file.is_file() and file.stat().st_mtime_ns >= photo.stat().st_mtime_ns
    return file if is_new else None


def copies_of(name: str) -> list[str]:
    """Return the names of all copies of a photo, the smallest first."""
    return [f"{name}.{side}.jpg" for side in _SIDES]


def _kept_side(side: int) -> int:
    return next((one for one in _SIDES if one >= side), _SIDES[-1])


def _copy_of(photo: Path, cache: Path, kept: int) -> Path:
    return cache / copies_of(photo.name)[_SIDES.index(kept)]


def write_small_photo(photo: Path, out: Path, *, side: int = SMALL_SIDE) -> None:
    """Decode `photo`, which checks it too, and write it with a longest side of at most `side` pixels.

    Raises
    ------
    PhotoError
        When the photo cannot be read.
    """
    from ..photos import load_pixels

    write_jpeg(load_pixels(photo, max_side=side), out)


def write_jpeg(pixels: NDArray[np.uint8], out: Path) -> None:
    """Write a picture atomically.

    Parameters
    ----------
    pixels : uint8 array of shape [height, width, 3]
        Red, green, blue.

    Raises
    ------
    FormatError
        When it is too large for JPEG.
    """
    import cv2

    ok, encoded = cv2.imencode(".jpg", pixels[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not ok:
        raise FormatError(f"{out} could not be written as JPEG.")
    out.parent.mkdir(parents=True, exist_ok=True)
    write_file(out, encoded.tobytes())
