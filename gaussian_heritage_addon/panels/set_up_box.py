"""The box that leads from a new installation to a ready engine, in the sidebar and in the preferences."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_n

from ..blender.drawn_text import draw_text
from ..jobs import job_runner
from ..setup.installation import installed_engine
from ..setup.preferences import engine_problem, set_up_options, set_up_problem
from .job_box import draw_job

SET_UP_KINDS = ("set-up", "remove engine")
"""Kinds of jobs that `draw_set_up` tells of. The state of the engine says nothing meanwhile."""

_NOT_READY = (
    pgettext_n("The engine is not set up yet."),
    pgettext_n("The set-up of the engine is not complete."),
    pgettext_n("The engine was set up by another version of this add-on."),
)
"""With these `engine_problem` begins, and goes on with the button to press, which stands right below here."""
_LABELS = {
    "missing": pgettext_n("Set Up Engine"),
    "incomplete": pgettext_n("Continue Set-Up"),
    "outdated": pgettext_n("Update Engine"),
}


def set_up_label() -> str:
    """Return what setting up means now, as a label: first set-up, continuation, update or repair."""
    return _LABELS.get(installed_engine().state(), pgettext_n("Repair Engine"))


def draw_set_up(layout: bpy.types.UILayout, *, in_preferences: bool = False) -> bool:
    """Draw what leads to an engine, or its progress; return False, and draw nothing, when there is an engine.

    Parameters
    ----------
    in_preferences : bool
        Whether the field *Offline Bundle* stands below.
    """
    job = job_runner.current()
    if job is not None and job[0].kind in SET_UP_KINDS and not job[1].finished:
        draw_job(layout, *job)
        if job[1].running:
            if job[0].kind == "remove engine":
                draw_text(
                    layout,
                    "The engine is being deleted. This goes on when the add-on is uninstalled or Blender is closed. "
                    "If its folder is there afterwards, delete it by hand.",
                    icon="INFO",
                )
            return True
    problem = engine_problem()
    if not problem:
        return False
    failed_here = job is not None and job[0].kind == "set-up"
    if not failed_here and (reason := set_up_problem()):
        # Of an earlier session: what is known of it must not be lost with Blender.
        draw_text(layout, reason, icon="ERROR")
    draw_text(layout, next((short for short in _NOT_READY if problem.startswith(short)), problem), icon="INFO")
    if _needs_network():
        _draw_online_access(layout)
        if in_preferences:
            draw_text(layout, "Without a network: choose an Offline Bundle below.")
        else:
            draw_text(
                layout, "Without a network: choose an Offline Bundle in Preferences > Add-ons > Gaussian Heritage."
            )
    column = layout.column()
    column.enabled = not _needs_network()
    column.scale_y = 1.6
    column.operator("heritage.set_up_engine", text=set_up_label(), icon="IMPORT")
    return True


def _needs_network() -> bool:
    return not (bpy.app.online_access or set_up_options()[2])


def _draw_online_access(layout: bpy.types.UILayout) -> None:
    """Draw the switch of Blender's own preferences by which programs in Blender may use the network."""
    draw_text(layout, "Setting up downloads the engine, and Blender may not use the network yet.", icon="INTERNET")
    if bpy.app.online_access_override:
        # The switch has no effect then.
        draw_text(layout, "Blender was started with --offline-mode. Start it without that option.")
    else:
        column = layout.column()
        column.scale_y = 1.6
        system = bpy.context.preferences.system
        column.prop(system, "use_online_access", text="Allow Online Access", toggle=True, icon="INTERNET")
