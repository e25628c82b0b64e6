"""Facts of EXIF about how a photo was taken, for the record. Places, names and serial numbers are left out."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ..core.visible_text import visible
from .exif import MAKE, MODEL, SOFTWARE, exif_number, read_exif
from .pixels import opened_picture, photo_errors

_TEXTS = {
    MAKE: "camera_make",
    MODEL: "camera_model",
    SOFTWARE: "software",
    0xA433: "lens_make",
    0xA434: "lens_model",
}
_NUMBERS = {
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
        exif = read_exif(image)
    facts: dict[str, Any] = {
        "taken": _time(exif.get(_TAKEN), exif.get(_OFFSET)),
        **{name: _text(exif.get(tag)) for tag, name in _TEXTS.items()},
        **{name: _number(exif.get(tag)) for tag, name in _NUMBERS.items()},
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
    number = exif_number(value)
    return None if number is None else round(number, 9)
