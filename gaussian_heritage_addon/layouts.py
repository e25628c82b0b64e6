"""Parts of panels that several of them draw."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

import bpy

from .curve import Point
from .jobs import Job, JobState
from .pictures import curve_icon, picture_icon

__all__ = ["draw_curve", "draw_job", "say"]

_LETTER = 6.5
"""Pixels of a letter, about, at Blender's usual size."""
_LETTERS_WITHOUT_REGION = 60


def say(layout: bpy.types.UILayout, text: str, *, icon: str = "NONE", letters: int | None = None) -> None:
    """Write `text` in lines of at most `letters`, by default as the region is wide: a label does not wrap."""
    region = bpy.context.region
    if letters is None and region is None:
        letters = _LETTERS_WITHOUT_REGION
    elif letters is None:
        letters = max(20, int(region.width / (_LETTER * bpy.context.preferences.system.ui_scale)) - 6)
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, letters) or [""]):
        column.label(text=line, icon=icon if number == 0 or icon == "NONE" else "BLANK1")


def draw_job(layout: bpy.types.UILayout, job: Job, state: JobState) -> None:
    """Draw what a job does, with its picture and curve, or how it ended."""
    box = layout.box()
    if state.running:
        say(box, state.message or job.subject)
        box.progress(factor=state.fraction, text=state.line())
        icon = picture_icon(Path(state.preview)) if state.preview else 0
        if icon:
            box.template_icon(icon_value=icon, scale=8.0)
        for name, value in state.metrics.items():
            box.label(text=f"{name}: {value:.4g}")
        box.operator("heritage.cancel_job", icon="CANCEL")
    elif state.error:
        say(box, state.error, icon="ERROR")
    else:
        say(box, state.message or "Done.", icon="CHECKMARK")
    for warning in state.warnings[-3:]:
        say(box, warning, icon="INFO")
    draw_curve(box, job.subject, state.curve)


def draw_curve(layout: bpy.types.UILayout, subject: str, points: Sequence[Point]) -> None:
    """Draw error against run time; nothing before it was measured."""
    if not points:
        return
    seconds, psnr = points[-1]
    layout.label(text=f"{psnr:.1f} dB after {seconds:.0f} s (photos not trained on)")
    icon = curve_icon(subject, points)
    if icon:
        layout.template_icon(icon_value=icon, scale=8.0)
        layout.label(text="PSNR in dB, higher is better, against seconds")
