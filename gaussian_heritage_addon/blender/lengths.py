"""Lengths of the real world as people type and read them: 30 cm, 1.2 m, 4 ft."""

from __future__ import annotations

import math

import bpy

from ...engine.core.errors import SettingsError

_DIGITS = 6


def read_length(text: str) -> float:
    """Return the metres of a length with any unit that Blender knows; without a unit, it is in metres.

    Raises
    ------
    SettingsError
        When it is no length above 0.
    """
    # As in German: Blender takes a comma for the beginning of another number.
    plain = text.replace(",", ".") if text.count(",") == 1 and "." not in text else text
    try:
        # The unit scale of the scene does not count: this is a length of the real thing.
        metres = float(bpy.utils.units.to_value("METRIC", "LENGTH", plain, str_ref_unit="m"))
    except ValueError:
        metres = math.nan
    if not (math.isfinite(metres) and metres > 0):
        raise SettingsError(f"{text[:100]!r} is no length. Enter for example 30 cm, 1.2 m or 4 ft.")
    # Blender calculates in float32.
    return float(f"{metres:.{_DIGITS}g}")


def write_length(metres: float) -> str:
    """Return metres as text with a fitting unit, such as ``30 cm``."""
    if not (math.isfinite(metres) and metres > 0):
        return ""
    text: str = bpy.utils.units.to_string("METRIC", "LENGTH", metres, precision=_DIGITS)
    return text
