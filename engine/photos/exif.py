"""EXIF data of a photo: orientation, focal length and time of capture."""

from __future__ import annotations

import contextlib
import logging
import math
import re
import threading
import warnings
from collections.abc import Iterator
from typing import Any

from PIL import Image

from .structure import MAX_EXIF_BYTES

_LOG = logging.getLogger(__name__)

MAKE, MODEL, SOFTWARE = 0x010F, 0x0110, 0x0131
_ORIENTATION = 0x0112
_GENERAL_TAGS = (MAKE, MODEL, SOFTWARE, _ORIENTATION)
_EXIF_IFD = 0x8769
_FOCAL_LENGTH = 0x920A
_FOCAL_LENGTH_35MM = 0xA405
_PIXEL_WIDTH, _PIXEL_HEIGHT = 0xA002, 0xA003
_PLANE_X_RESOLUTION = 0xA20E
_PLANE_UNIT = 0xA210
_TAKEN, _TAKEN_FRACTION = 0x9003, 0x9291
_UNIT_IN_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
_FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)

# Focal length over the longest side, from a wide fisheye to a 1,200 mm telephoto lens. Values outside of this range are
# errors in the EXIF data.
_PLAUSIBLE_FOCAL_RATIOS = (0.2, 35.0)

UPRIGHT_TRANSPOSES: dict[int, Image.Transpose] = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
"""EXIF orientation to the transpose that makes the stored pixels upright."""


class _PillowWarnings:
    """Suppresses Pillow's warnings while any thread is inside of a block.

    Warning filters apply to the whole process: a thread that restored them would change the filters of the others.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._n_inside = 0
        self._filters = contextlib.ExitStack()

    @contextlib.contextmanager
    def suppressed(self) -> Iterator[None]:
        with self._lock:
            if self._n_inside == 0:
                self._filters.enter_context(warnings.catch_warnings())
                warnings.filterwarnings("ignore", module=r"PIL\.")
            self._n_inside += 1
        try:
            yield
        finally:
            with self._lock:
                self._n_inside -= 1
                if self._n_inside == 0:
                    self._filters.close()


_WARNINGS = _PillowWarnings()


def without_pillow_warnings() -> contextlib.AbstractContextManager[None]:
    """Suppress Pillow's warnings about damaged metadata on stderr; Pillow ignores the damaged data and continues."""
    return _WARNINGS.suppressed()


def read_exif(image: Image.Image) -> dict[int, Any]:
    """Return the EXIF values of a photo by their tags; empty where it has none, or damaged ones."""
    data = image.info.get("exif")
    if isinstance(data, bytes | str) and len(data) > MAX_EXIF_BYTES:
        _LOG.warning("EXIF of %d bytes is ignored.", len(data))
        return {}
    # On damaged EXIF Pillow raises an exception of any type, or warns on stderr and continues. The pixels are still
    # valid, so the photo is used without EXIF.
    try:
        with without_pillow_warnings():
            exif = image.getexif()
            return {**exif.get_ifd(_EXIF_IFD), **{tag: exif[tag] for tag in _GENERAL_TAGS if tag in exif}}
    except Exception as error:
        _LOG.warning("Damaged EXIF is ignored: %r", error)
        return {}


def orientation_of(image: Image.Image) -> int:
    """Return the EXIF orientation, 1 to 8, that must still be applied to `image`, whose pixels must be loaded.

    Notes
    -----
    Pillow (TIFF) and pillow-heif (HEIC) apply the orientation on loading and then report 1.
    """
    value = exif_number(read_exif(image).get(_ORIENTATION))
    return int(value) if value in UPRIGHT_TRANSPOSES else 1


def focal_in_pixels(image: Image.Image) -> float | None:
    """Return the focal length in pixels of `image` from its EXIF; None when EXIF does not contain it.

    Notes
    -----
    ``FocalLengthIn35mmFilm`` f refers to the diagonal (CIPA DCG-001): f * diagonal in pixels / 43.27 mm, for the whole
    sensor. The value is wrong for a cropped photo; bundle adjustment then refines it. Otherwise ``FocalLength`` times
    ``FocalPlaneXResolution``, which refers to pixels of the sensor and is scaled by the picture's longest side over the
    longest side in EXIF.
    """
    exif = read_exif(image)

    def number(tag: int) -> float:
        return exif_number(exif.get(tag)) or 0.0

    width, height = image.size
    focal = number(_FOCAL_LENGTH_35MM) * math.hypot(width, height) / _FILM_DIAGONAL_MM
    if not focal > 0.0:
        unit = _UNIT_IN_MM.get(int(number(_PLANE_UNIT)), 25.4)
        recorded = max(number(_PIXEL_WIDTH), number(_PIXEL_HEIGHT))
        scale = max(width, height) / recorded if recorded > 0.0 else 1.0
        focal = number(_FOCAL_LENGTH) * number(_PLANE_X_RESOLUTION) / unit * scale
    longest = max(width, height)
    if not _PLAUSIBLE_FOCAL_RATIOS[0] * longest <= focal <= _PLAUSIBLE_FOCAL_RATIOS[1] * longest:
        return None
    return float(focal)


def capture_time(image: Image.Image) -> str | None:
    """Return when a photo was taken by its EXIF, ``2024:05:17 10:31:02.25``; None when EXIF does not say it."""
    exif = read_exif(image)
    taken, fraction = (str(exif.get(tag, "")).strip("\0 ") for tag in (_TAKEN, _TAKEN_FRACTION))
    if not re.fullmatch(r"[1-9]\d{3}:\d\d:\d\d \d\d:\d\d:\d\d", taken):
        return None
    return f"{taken}.{fraction}" if fraction.isdigit() else taken


def exif_number(value: Any) -> float | None:
    """Return an EXIF value, or its first number, as a float; None when it is missing, no number, or not finite."""
    try:
        number = float(value[0] if isinstance(value, tuple) else value)
    except (TypeError, ValueError, ArithmeticError, IndexError):
        return None
    return number if math.isfinite(number) else None
