"""EXIF data of a photo: orientation, focal length and exposure value."""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import warnings
from collections.abc import Iterator
from typing import Any

from PIL import Image

__all__ = ["UPRIGHT_TRANSPOSES", "exposure_value", "focal_in_pixels", "orientation_of", "without_exif_warnings"]

_LOG = logging.getLogger(__name__)
_WARNING_FILTERS = threading.Lock()

_ORIENTATION = 0x0112
_EXIF_IFD = 0x8769
_EXPOSURE_TIME, _F_NUMBER, _SENSITIVITY = 0x829A, 0x829D, 0x8827
_FOCAL_LENGTH = 0x920A
_FOCAL_LENGTH_35MM = 0xA405
_PIXEL_WIDTH, _PIXEL_HEIGHT = 0xA002, 0xA003
_PLANE_X_RESOLUTION = 0xA20E
_PLANE_UNIT = 0xA210
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


@contextlib.contextmanager
def without_exif_warnings() -> Iterator[None]:
    """Suppress Pillow's warnings about damaged EXIF on stderr; Pillow ignores the damaged data and continues."""
    # Warning filters apply to the whole process, so only one thread at a time may change them.
    with _WARNING_FILTERS, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _read(image: Image.Image) -> Image.Exif | None:
    # On damaged EXIF Pillow raises one of many exception types, or warns on stderr and continues. The pixels are still
    # valid, so the photo is used without EXIF.
    try:
        with without_exif_warnings():
            exif = image.getexif()
            exif.get_ifd(_EXIF_IFD)
    except (SyntaxError, ValueError, TypeError, KeyError, OSError, IndexError, ArithmeticError) as error:
        _LOG.warning("Damaged EXIF is ignored: %s", error)
        return None
    return exif


def orientation_of(image: Image.Image) -> int:
    """Return the EXIF orientation, 1 to 8, that must still be applied to `image`, whose pixels must be loaded.

    Notes
    -----
    Pillow (TIFF) and pillow-heif (HEIC) apply the orientation on loading and then report 1.
    """
    exif = _read(image)
    value = exif.get(_ORIENTATION, 1) if exif is not None else 1
    return value if value in UPRIGHT_TRANSPOSES else 1


def focal_in_pixels(image: Image.Image) -> float | None:
    """Return the focal length in pixels of `image` from its EXIF; None when EXIF does not contain it.

    Notes
    -----
    ``FocalLengthIn35mmFilm`` f refers to the diagonal (CIPA DCG-001): f * diagonal in pixels / 43.27 mm, for the whole
    sensor. The value is wrong for a cropped photo; bundle adjustment then refines it. Otherwise ``FocalLength`` times
    ``FocalPlaneXResolution``, which refers to pixels of the sensor and is scaled by the picture's longest side over the
    longest side in EXIF.
    """
    exif = _read(image)
    if exif is None:
        return None
    tags = exif.get_ifd(_EXIF_IFD)
    width, height = image.size
    focal = _number(tags.get(_FOCAL_LENGTH_35MM)) * math.hypot(width, height) / _FILM_DIAGONAL_MM
    if not focal > 0.0:
        millimetres = _number(tags.get(_FOCAL_LENGTH))
        per_unit = _number(tags.get(_PLANE_X_RESOLUTION))
        unit = _UNIT_IN_MM.get(int(_number(tags.get(_PLANE_UNIT, 2))), 25.4)
        recorded = max(_number(tags.get(_PIXEL_WIDTH)), _number(tags.get(_PIXEL_HEIGHT)))
        scale = max(width, height) / recorded if recorded > 0.0 else 1.0
        focal = millimetres * per_unit / unit * scale
    longest = max(width, height)
    if not _PLAUSIBLE_FOCAL_RATIOS[0] * longest <= focal <= _PLAUSIBLE_FOCAL_RATIOS[1] * longest:
        return None
    return float(focal)


def exposure_value(image: Image.Image) -> float | None:
    """Return the exposure value at ISO 100 of the camera's settings; None when EXIF does not contain it.

    Notes
    -----
    log2(N^2 / t) - log2(S / 100) with aperture N, exposure time t in seconds and sensitivity S (ISO 2720). A value that
    is larger by one halves the brightness of the same scene in the picture.
    """
    exif = _read(image)
    if exif is None:
        return None
    tags = exif.get_ifd(_EXIF_IFD)
    sensitivity = tags.get(_SENSITIVITY)
    if isinstance(sensitivity, tuple):
        sensitivity = sensitivity[0] if sensitivity else None
    aperture, seconds, speed = (_number(v) for v in (tags.get(_F_NUMBER), tags.get(_EXPOSURE_TIME), sensitivity))
    if not (aperture > 0.0 and seconds > 0.0 and speed > 0.0):
        return None
    return math.log2(aperture**2 / seconds * 100.0 / speed)


def _number(value: Any) -> float:
    """Return an EXIF value as a float; 0 when it is missing, not a number or 0/0."""
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return 0.0
    return number if math.isfinite(number) else 0.0
