"""A glance at each photo on a small version: brightness, texture and the exposure its camera was set to."""

from __future__ import annotations

import json
import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import Cancelled, FormatError
from ..events import StopCheck, never_stop
from ..scene import PhotoSet
from .exif import exposure_value
from .pixels import open_photo, upright_pixels

__all__ = ["PhotoLook", "look_at_photos", "read_looks"]

_SIDE = 256
_EDGE = 0.03
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)


@dataclass(frozen=True)
class PhotoLook:
    """What a small version of a photo shows.

    Attributes
    ----------
    name : str
    brightness : float
        log2 of the geometric mean of linear luminance (0 to 1, plus 0.01): stops.
    texture : float
        Share of pixels whose brightness changes by more than 3 % from one to the next at 256 pixels' width.
    exposure_value : float or None
        Of the camera's settings at ISO 100, stops; None when EXIF does not say.
    """

    name: str
    brightness: float
    texture: float
    exposure_value: float | None


def look_at_photos(photo_set: PhotoSet, *, should_stop: StopCheck = never_stop) -> list[PhotoLook]:
    """Return a look at each photo of the set, in its order; a few milliseconds of CPU each for a JPEG.

    Raises
    ------
    PhotoError
        When a photo went away or was damaged meanwhile.
    Cancelled
        When `should_stop` says so.
    """
    looks = []
    pool = ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1))
    try:
        for look in pool.map(lambda photo: _look_at(photo_set, photo.name), photo_set.photos):
            looks.append(look)
            if should_stop():
                raise Cancelled("Looking at the photos was stopped. Nothing was changed.")
    finally:
        pool.shutdown(cancel_futures=True)
    return looks


def read_looks(path: Path) -> list[PhotoLook]:
    """Return the looks stored at `path` as a JSON list of their fields.

    Raises
    ------
    FormatError
        When the file is missing or damaged.
    """
    try:
        return [PhotoLook(**look) for look in json.loads(path.read_text(encoding="utf-8"))]
    except (OSError, ValueError, TypeError) as error:
        raise FormatError(f"{path} cannot be read: {error}. Delete it and run again.") from error


def _look_at(photo_set: PhotoSet, name: str) -> PhotoLook:
    image, _ = open_photo(photo_set.folder / name, max_side=_SIDE)
    value = exposure_value(image)
    pixels = upright_pixels(image, max_side=_SIDE).astype(np.float32) / 255.0
    linear = np.where(pixels <= 0.04045, pixels / 12.92, ((pixels + 0.055) / 1.055) ** 2.4) @ _LUMINANCE
    brightness = math.log2(float(np.exp(np.log(linear + 0.01).mean())))
    down, right = np.gradient(pixels.mean(axis=2))
    texture = float((np.hypot(down, right) > _EDGE).mean())
    return PhotoLook(name, brightness, texture, value)
