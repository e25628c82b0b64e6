"""The box that leads from a new installation to a ready engine, in the sidebar and in the preferences."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_n

from . import job_runner
from .installation import installed_engine
from .layouts import draw_job, draw_text
from .preferences import engine_problem

__all__ = ["draw_set_up", "set_up_label"]

_LABELS = {
    "missing": pgettext_n("Set Up Engine"),
    "incomplete": pgettext_n("Continue Set-Up"),
    "outdated": pgettext_n("Update Engine"),
}


def set_up_label() -> str:
    """Return what setting up means now, as a label: first set-up, continuation, update or repair."""
    return _LABELS.get(installed_engine().state(), pgettext_n("Repair Engine"))


def draw_set_up(layout: bpy.types.UILayout) -> bool:
    """Draw what leads to an engine, or its progress; return False, and draw nothing, when there is an engine."""
    job = job_runner.current()
    if job is not None and job[0].kind == "set-up" and not job[1].finished:
        draw_job(layout, *job)
        if job[1].running:
            return True
    problem = engine_problem()
    if not problem:
        return False
    draw_text(layout, problem, icon="INFO")
    column = layout.column()
    column.scale_y = 1.6
    column.operator("heritage.set_up_engine", text=set_up_label(), icon="IMPORT")
    return True
