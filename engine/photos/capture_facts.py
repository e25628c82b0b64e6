"""Facts of EXIF about how a photo was taken, for the record. Places, names and serial numbers are left out."""

from __future__ import annotations

import logging
import math
import re
from pathlib import Path
from typing import Any

from ..core.visible_text import visible
from .exif import without_pillow_warnings
from .pixels import opened_picture, photo_errors
from .structure import MAX_EXIF_BYTES

_LOG = logging.getLogger(__name__)
_EXIF_IFD = 0x8769
_TEXTS = {0x010F: "camera_make", 0x0110: "camera_model", 0x0131: "software"}
_CAMERA_TEXTS = {0xA433: "lens_make", 0xA434: "lens_model"}
_CAMERA_NUMBERS = {
    0x829A: "exposure_seconds",
    0x829D: "f_number",
    0x8827: "iso",
    0x920A: "focal_length_mm",
    0xA405: "focal_length_35mm",
    0x9204: "exposure_bias_ev",
}
_TAKEN, _OFFSET = 0x9003, 0x9011
_MAX_TEXT = 200
_DATE = re.compile(r"(\d{4}):(\d\d):(\d\d) (\d\d:\d\d:\d\d)")
_ZONE = re.compile(r"[+-]\d\d:\d\d|Z")


def exif_facts(path: Path) -> dict[str, Any]:
    """Return the facts of a photo's EXIF, by name; empty where it has none that can be read.

    Parameters
    ----------
    path : Path
        A photo.

    Returns
    -------
    dict
        ``taken`` (ISO 8601, with the offset from UTC where the camera states it), ``camera_make``, ``camera_model``,
        ``lens_make``, ``lens_model``, ``software`` (texts), ``exposure_seconds``, ``f_number``, ``iso``,
        ``focal_length_mm``, ``focal_length_35mm`` and ``exposure_bias_ev`` (numbers).

    Raises
    ------
    PhotoError
        When the file is no photo that can be read.
    """
    with photo_errors(path), opened_picture(path, None) as (image, _):
        data = image.info.get("exif")
        if isinstance(data, bytes | str) and len(data) > MAX_EXIF_BYTES:
            return {}
        # Pillow raises exceptions of many types on damaged EXIF; the photo itself was read without it too.
        try:
            with without_pillow_warnings():
                exif = image.getexif()
                camera = dict(exif.get_ifd(_EXIF_IFD))
                general = {tag: exif.get(tag) for tag in _TEXTS}
        except Exception as error:
            _LOG.warning("Damaged EXIF of %s is ignored: %r", visible(path.name), error)
            return {}
    facts: dict[str, Any] = {
        "taken": _time(camera.get(_TAKEN), camera.get(_OFFSET)),
        **{name: _text(general[tag]) for tag, name in _TEXTS.items()},
        **{name: _text(camera.get(tag)) for tag, name in _CAMERA_TEXTS.items()},
        **{name: _number(camera.get(tag)) for tag, name in _CAMERA_NUMBERS.items()},
    }
    return {name: value for name, value in facts.items() if value is not None}


def _time(taken: Any, offset: Any) -> str | None:
    found = _DATE.match(taken) if isinstance(taken, str) else None
    if found is None:
        return None
    zone = offset if isinstance(offset, str) and _ZONE.fullmatch(offset) else ""
    return f"{found[1]}-{found[2]}-{found[3]}T{found[4]}{zone}"


def _text(value: Any) -> str | None:
    text = visible(value.strip("\0 "))[:_MAX_TEXT] if isinstance(value, str) else ""
    return text or None


def _number(value: Any) -> float | None:
    try:
        number = float(value[0] if isinstance(value, tuple) else value)
    except (TypeError, ValueError, ArithmeticError, IndexError):
        return None
    return round(number, 9) if math.isfinite(number) else None
