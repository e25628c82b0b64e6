"""The state of a job in a panel: its progress, preview image and training curve, or its result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_n

from ...engine.core.stage_names import STAGE_NAMES
from ...engine.workers.jobs import Job, JobState, format_seconds, seconds_left_in_all
from ..blender.drawn_text import draw_text
from ..language.translations import translated
from ..project.curve import Point
from ..project.pictures import curve_icon, picture_icon
from ..project.planned_device import planned_device
from .question_box import draw_asking

_METRICS = {
    "registered_photos": pgettext_n("Photos with a camera: {:.0f}"),
    "sparse_points": pgettext_n("Points in space: {:,.0f}"),
    "reprojection_error_px": pgettext_n("Error of the cameras: {:.2f} pixels"),
    "gaussians": pgettext_n("Gaussians: {:,.0f}"),
    "psnr": pgettext_n("PSNR of photos not trained on: {:.1f} dB"),
}
"""Metrics that are shown. The others are for programs."""


def progress_text(state: JobState) -> str:
    """Return how far a job is, for a progress bar, which cuts what does not fit."""
    share, stage = f"{state.fraction:.0%}", translated(STAGE_NAMES.get(state.stage, state.stage))
    if state.seconds_left is None:
        return f"{share}  {stage}"
    return translated("{}, {} left: {}", share, format_seconds(state.seconds_left), stage)


def device_text(name: str, reason: str) -> str:
    """Return what is trained on, and why it is not the card, in the language of the user; see `planned_device`."""
    trains = translated("Trains on {}", translated("the processor") if name == "cpu" else name)
    return translated("{}, because {}", trains, translated(reason)) if reason else trains


def draw_job(layout: bpy.types.UILayout, job: Job, state: JobState, *, bar: bool = True) -> None:
    """Draw the progress of a job with its preview image and training curve, or its result.

    Without `bar` where the progress bar and its button stand elsewhere already.
    """
    box = layout.box()
    if job.of_earlier_session:
        draw_text(box, "Started before Blender was closed", icon="TIME", n_boxes=1)
    if state.running:
        if bar:
            row = box.row(align=True)
            row.progress(factor=state.fraction, text=progress_text(state))
            row.operator("heritage.cancel_job", text="", icon="CANCEL")
        draw_text(box, state.message or job.subject, n_boxes=1)
        left = seconds_left_in_all(Path(job.subject), state) if job.kind == "reconstruct" else None
        if left is not None:
            box.label(text=translated("About {} left in all", format_seconds(left)), icon="TIME")
        device = planned_device(Path(job.subject)) if job.kind == "reconstruct" else None
        if device is not None:
            draw_text(box, device_text(*device), icon="SYSTEM", n_boxes=1)
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
    draw_asking(box, Path(job.subject))
    for warning in state.warnings[-3:]:
        draw_text(box, warning, icon="INFO", n_boxes=1)
    draw_curve(box, job.subject, state.curve)


def draw_curve(layout: bpy.types.UILayout, subject: str, points: Sequence[Point]) -> None:
    """Draw PSNR against run time; nothing when `points` is empty."""
    if not points:
        return
    seconds, psnr = points[-1]
    draw_text(layout, translated("{:.1f} dB after {:.0f} s (photos not trained on)", psnr, seconds), n_boxes=1)
    icon = curve_icon(subject, points)
    if icon:
        layout.template_icon(icon_value=icon, scale=8.0)
        draw_text(layout, "PSNR in dB, higher is better, against seconds", n_boxes=1)
