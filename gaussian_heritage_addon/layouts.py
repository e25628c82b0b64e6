"""Drawing functions shared by several panels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import blf
import bpy
from bpy.app.translations import pgettext_n

from ..engine.jobs import Job, JobState, format_seconds, seconds_left_in_all
from .curve import Point
from .pictures import curve_icon, picture_icon
from .planned_device import planned_device
from .problems import plain_text
from .text_lines import lines_of
from .translations import translated

__all__ = ["draw_curve", "draw_job", "draw_text"]

_MARGIN, _BOX_MARGIN, _ICON_WIDTH, _LEAST_WIDTH = 40, 16, 20, 100
"""Widths in pixels at the default interface scale: of both margins of a panel with its tabs, of those of a box, of
an icon, and of the narrowest line."""
_DEFAULT_LINE_LENGTH = 60
"""Characters per line where the width of the region is not known."""
_MAX_LENGTH = 2000
"""Characters of a text that are drawn: a project from someone else may hold any text."""

_METRICS = {
    "registered_photos": pgettext_n("Photos with a camera: {:.0f}"),
    "sparse_points": pgettext_n("Points in space: {:,.0f}"),
    "reprojection_error_px": pgettext_n("Error of the cameras: {:.2f} pixels"),
    "gaussians": pgettext_n("Gaussians: {:,.0f}"),
    "psnr": pgettext_n("PSNR of photos not trained on: {:.1f} dB"),
}
"""Metrics that are shown. The others are for programs."""


def draw_text(
    layout: bpy.types.UILayout, text: str, *, icon: str = "NONE", line_length: int | None = None, n_boxes: int = 0
) -> None:
    """Draw `text` in lines that fit: labels do not wrap.

    Parameters
    ----------
    layout : UILayout
    text : str
    icon : str
        Before the first line.
    line_length : int, optional
        Characters of a line, for a dialog; by default, lines fit the region.
    n_boxes : int
        Boxes around `layout`, whose margins make lines shorter.
    """
    region = bpy.context.region
    shown = translated(plain_text(text)[:_MAX_LENGTH])
    if line_length is not None or region is None:
        lines = lines_of(shown, line_length or _DEFAULT_LINE_LENGTH, len)
    else:
        margins = _MARGIN + _BOX_MARGIN * n_boxes + (_ICON_WIDTH if icon != "NONE" else 0)
        width = region.width / bpy.context.preferences.system.ui_scale - margins
        lines = lines_of(shown, max(width, _LEAST_WIDTH), _width_of)
    column = layout.column(align=True)
    for number, line in enumerate(lines):
        column.label(text=line, icon=icon if number == 0 or icon == "NONE" else "BLANK1")


def _width_of(text: str) -> float:
    """Return the width of a label in pixels at Blender's default interface scale."""
    blf.size(0, bpy.context.preferences.ui_styles[0].widget.points)
    width: float = blf.dimensions(0, text)[0]
    return width


def draw_job(layout: bpy.types.UILayout, job: Job, state: JobState, *, bar: bool = True) -> None:
    """Draw the progress of a job with its preview image and training curve, or its result.

    Without `bar` where the progress bar and its button stand elsewhere already.
    """
    box = layout.box()
    if job.of_earlier_session:
        box.label(text="Started before Blender was closed", icon="TIME")
    if state.running:
        if bar:
            row = box.row(align=True)
            row.progress(factor=state.fraction, text=state.progress_line())
            row.operator("heritage.cancel_job", text="", icon="CANCEL")
        draw_text(box, state.message or job.subject, n_boxes=1)
        left = seconds_left_in_all(Path(job.subject), state) if job.kind == "reconstruct" else None
        if left is not None:
            box.label(text=translated("About {} left in all", format_seconds(left)), icon="TIME")
        device = planned_device(Path(job.subject)) if job.kind == "reconstruct" else ""
        if device:
            draw_text(box, device, icon="SYSTEM", n_boxes=1)
        icon = picture_icon(Path(state.preview)) if state.preview else 0
        if icon:
            box.template_icon(icon_value=icon, scale=8.0)
        for name, value in state.metrics.items():
            if name in _METRICS:
                text = _METRICS[name]
                box.label(text=translated(text, value))
    elif state.error_type == "PromptError":
        # The panel Objects has the sentence, with the candidates.
        box.label(text="Not found", icon="QUESTION")
    elif state.error:
        draw_text(box, state.error, icon="ERROR", n_boxes=1)
    else:
        draw_text(box, state.message or "Done.", icon="CHECKMARK", n_boxes=1)
    for warning in state.warnings[-3:]:
        draw_text(box, warning, icon="INFO", n_boxes=1)
    draw_curve(box, job.subject, state.curve)


def draw_curve(layout: bpy.types.UILayout, subject: str, points: Sequence[Point]) -> None:
    """Draw PSNR against run time; nothing when `points` is empty."""
    if not points:
        return
    seconds, psnr = points[-1]
    layout.label(text=translated("{:.1f} dB after {:.0f} s (photos not trained on)", psnr, seconds))
    icon = curve_icon(subject, points)
    if icon:
        layout.template_icon(icon_value=icon, scale=8.0)
        layout.label(text="PSNR in dB, higher is better, against seconds")
