"""The presets as a choice, each with what it is for and how long it takes for the photos at hand."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...engine.photos.settings import PHOTO_SUFFIXES, VIDEO_SUFFIXES
from ...engine.training.settings import OFFERED_PRESETS
from ...engine.workers.jobs import format_seconds
from ..blender.drawn_text import draw_text
from ..jobs import preset_times
from ..language.translations import translated

_MAX_LOOKED_AT = 2000
"""Entries of a folder that are looked at for a photo."""


def draw_presets(
    layout: bpy.types.UILayout, operator: bpy.types.Operator, photos: Path | None, *, line_length: int | None = None
) -> None:
    """Draw the property ``preset`` of `operator`.

    Parameters
    ----------
    photos : Path or None
        Folder of photos that the times are for.
    line_length : int, optional
        See `draw_text`.
    """
    seconds = None
    is_asked = photos is not None and _has_photos(photos)
    if photos is not None and is_asked:
        preset_times.ask(photos)
        seconds = preset_times.preset_seconds(photos)
    layout.label(text="Preset")
    for preset in OFFERED_PRESETS:
        column = layout.column(align=True)
        column.prop_enum(operator, "preset", preset.name)
        draw_text(column, preset.description, line_length=line_length)
        if seconds and preset.name in seconds:
            column.label(text=duration_words(seconds[preset.name]), icon="TIME")
    if is_asked and seconds is None:
        draw_text(layout, "Reading these photos to say how long each takes ...", icon="TIME", line_length=line_length)
        if preset_times.progress():
            draw_text(layout, preset_times.progress(), icon="BLANK1", line_length=line_length)


def duration_words(seconds: float) -> str:
    """Return a forecast as words for a label."""
    return translated("About {} for these photos", format_seconds(seconds))


def _has_photos(folder: Path) -> bool:
    try:
        if folder.suffix.lower() in VIDEO_SUFFIXES:
            return False
        for number, entry in enumerate(folder.iterdir()):
            if entry.suffix.lower() in PHOTO_SUFFIXES:
                return True
            if number > _MAX_LOOKED_AT:
                return False
    except (OSError, ValueError):  # ValueError: a null character in the path
        return False
    return False
