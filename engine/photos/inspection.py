"""Statistics of each photo: the texture of a reduced version."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import Cancelled, FormatError
from ..core.events import StopCheck, never_stop
from ..core.files import read_json
from ..scene import PhotoSet
from .bounded import call_within_bounds
from .pixels import open_photo, read_header, upright_with_alpha

_MAX_SIDE = 256
_MIN_EDGE = 0.03
_SCHEMA = [{"name": str, "texture": float}]
_ADVICE = "Delete it and run again."


@dataclass(frozen=True)
class PhotoStatistics:
    """Statistics of one photo, measured with its longest side reduced to 256 pixels.

    Attributes
    ----------
    name : str
    texture : float
        Share of the pixels whose grey value changes by more than 3 % per pixel.
    """

    name: str
    texture: float


def inspect_photos(photo_set: PhotoSet, *, should_stop: StopCheck = never_stop) -> list[PhotoStatistics]:
    """Return the statistics of each photo of the set, in its order; a few milliseconds of CPU per JPEG.

    Raises
    ------
    PhotoError
        When a photo was removed or damaged since the set was read.
    Cancelled
        When `should_stop` returns True.
    """
    statistics = []
    pool = ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1))
    try:
        for photo_statistics in pool.map(lambda photo: _inspect(photo_set, photo.name, should_stop), photo_set.photos):
            statistics.append(photo_statistics)
            if should_stop():
                raise Cancelled("The inspection of the photos was stopped. Nothing was changed.")
    finally:
        pool.shutdown(cancel_futures=True)
    return statistics


def read_photo_statistics(path: Path) -> list[PhotoStatistics]:
    """Return the statistics stored at `path` as a JSON list of their fields.

    Raises
    ------
    FormatError
        When the file is missing or damaged.
    """
    statistics = [
        PhotoStatistics(**{name: fields[name] for name in _SCHEMA[0]})
        for fields in read_json(path, _SCHEMA, advice=_ADVICE)
    ]
    for photo in statistics:
        if not 0.0 <= photo.texture <= 1.0:
            raise FormatError(f"{path} cannot be read: the numbers of {photo.name!r} are out of range. {_ADVICE}")
    return statistics


def _inspect(photo_set: PhotoSet, name: str, should_stop: StopCheck) -> PhotoStatistics:
    path = photo_set.folder / name
    header = read_header(path, max_side=_MAX_SIDE)
    return PhotoStatistics(name, **call_within_bounds(look_at, path, header, should_stop=should_stop))


def look_at(path: str) -> dict[str, Any]:
    """Decode a photo here and return the fields of `PhotoStatistics` without the name."""
    image, _ = open_photo(Path(path), max_side=_MAX_SIDE)
    pixels = upright_with_alpha(image, max_side=_MAX_SIDE)[0].astype(np.float32) / 255.0
    down, right = np.gradient(pixels.mean(axis=2))
    texture = float((np.hypot(down, right) > _MIN_EDGE).mean())
    return {"texture": texture}
