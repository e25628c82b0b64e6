"""Drawing functions shared by several panels."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_n

from ..engine.jobs import Job, JobState, format_seconds, seconds_left_in_all
from .curve import Point
from .pictures import curve_icon, picture_icon
from .planned_device import planned_device
from .problems import plain_text
from .translations import translated

__all__ = ["draw_curve", "draw_job", "draw_text"]

_CHARACTER_WIDTH = 6.5
"""Mean width of a character in pixels, at Blender's default interface scale."""
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


def draw_text(layout: bpy.types.UILayout, text: str, *, icon: str = "NONE", line_length: int | None = None) -> None:
    """Draw `text` in lines of at most `line_length` characters, by default to fit the region: labels do not wrap."""
    region = bpy.context.region
    if line_length is None and region is None:
        line_length = _DEFAULT_LINE_LENGTH
    elif line_length is None:
        line_length = max(20, int(region.width / (_CHARACTER_WIDTH * bpy.context.preferences.system.ui_scale)) - 6)
    column = layout.column(align=True)
    for number, line in enumerate(
        textwrap.wrap(translated(plain_text(text)[:_MAX_LENGTH]), line_length, break_on_hyphens=False) or [""]
    ):
        column.label(text=line, icon=icon if number == 0 or icon == "NONE" else "BLANK1")


def draw_job(layout: bpy.types.UILayout, job: Job, state: JobState) -> None:
    """Draw the progress of a job with its preview image and training curve, or its result."""
    box = layout.box()
    if job.of_earlier_session:
        box.label(text="Started before Blender was closed", icon="TIME")
    if state.running:
        row = box.row(align=True)
        row.progress(factor=state.fraction, text=state.progress_line())
        row.operator("heritage.cancel_job", text="", icon="CANCEL")
        draw_text(box, state.message or job.subject)
        left = seconds_left_in_all(Path(job.subject), state) if job.kind == "reconstruct" else None
        if left is not None:
            box.label(text=translated("About {} left in all", format_seconds(left)), icon="TIME")
        device = planned_device(Path(job.subject)) if job.kind == "reconstruct" else ""
        if device:
            draw_text(box, device, icon="SYSTEM")
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
        draw_text(box, state.error, icon="ERROR")
    else:
        draw_text(box, state.message or "Done.", icon="CHECKMARK")
    for warning in state.warnings[-3:]:
        draw_text(box, warning, icon="INFO")
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
