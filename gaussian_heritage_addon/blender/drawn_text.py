"""Text in panels and dialogs, broken into lines that fit: Blender's labels do not wrap."""

from __future__ import annotations

import blf
import bpy

from ..language.translations import language
from .problems import plain_text
from .text_lines import lines_of

_MARGIN, _BOX_MARGIN, _ICON_WIDTH, _LEAST_WIDTH = 66, 16, 20, 100
"""Widths in pixels at the default interface scale: of both margins of a panel with its tabs and of a label, of those of
a box, of an icon, and of the narrowest line. Those of Blender 5.2, which are wider than those of 4.5."""
_DEFAULT_LINE_LENGTH = 60
"""Characters per line where the width of the region is not known."""
_MAX_LENGTH = 2000
"""Characters of a text that are drawn: a project from someone else may hold any text."""


def draw_text(
    layout: bpy.types.UILayout, text: str, *, icon: str = "NONE", line_length: int | None = None, n_boxes: int = 0
) -> None:
    """Draw `text` in lines that fit: labels do not wrap.

    Parameters
    ----------
    icon : str
        Before the first line.
    line_length : int, optional
        Characters of a line, for a dialog; by default, lines fit the region.
    n_boxes : int
        Boxes around `layout`, whose margins make lines shorter.
    """
    region = bpy.context.region
    # What is shown is a text of ours or a sentence of the engine.
    shown = language().said(plain_text(text)[:_MAX_LENGTH])
    if line_length is not None or region is None:
        lines = lines_of(shown, line_length or _DEFAULT_LINE_LENGTH, len)
    else:
        margins = _MARGIN + _BOX_MARGIN * n_boxes + (_ICON_WIDTH if icon != "NONE" else 0)
        scale = bpy.context.preferences.system.ui_scale
        lines = lines_of(shown, max(region.width - scale * margins, scale * _LEAST_WIDTH), _width_of)
    column = layout.column(align=True)
    for number, line in enumerate(lines):
        column.label(text=line, icon=icon if number == 0 or icon == "NONE" else "BLANK1")


def _width_of(text: str) -> float:
    """Return the width of a label in pixels of the screen."""
    # At its own size: widths of letters are rounded to pixels.
    blf.size(0, bpy.context.preferences.ui_styles[0].widget.points * bpy.context.preferences.system.ui_scale)
    width: float = blf.dimensions(0, text)[0]
    return width
