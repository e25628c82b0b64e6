"""The first panel of the tab *Heritage*: what goes on, the next step, and the project."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...engine.pipeline.reconstruction_input import better_preset
from ...engine.project.content import report_file
from ...engine.workers.jobs import Job, JobState
from ..blender.default_objects import untouched_defaults
from ..blender.drawn_text import draw_text
from ..jobs import job_runner
from ..jobs.job_names import job_name
from ..language.translations import translated
from ..project.cameras import current_photo
from ..project.moved_projects import is_missing
from ..project.open_projects import is_open_elsewhere
from ..splats.properties import HeritageScene, project_of
from .job_box import progress_text
from .progress_panel import problems_of
from .set_up_box import draw_set_up
from .sidebar import SidebarPanel

_STATUS_SHARE = 0.65
"""Share of the width of the first row that *Stopped* gets, beside the button that continues the job."""
_HEALTH_ICONS = {"yellow": "INFO", "red": "ERROR"}
"""Colours of the cameras' health that are shown; nothing is said of green ones."""


class HERITAGE_PT_scene(SidebarPanel):
    """The next step, the project and its display."""

    bl_label = "Gaussian Heritage"
    bl_idname = "HERITAGE_PT_scene"
    bl_order = 0

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout = self.layout
        properties: HeritageScene = context.scene.heritage
        if draw_set_up(layout):
            return
        _draw_status(layout, context.scene)
        column = layout.column(align=True)
        column.operator("heritage.import_photo_folder", icon="IMAGE_DATA")
        column.operator("heritage.open_project", icon="FILE_FOLDER")
        if properties.project and untouched_defaults(context.scene):
            layout.operator("heritage.remove_default_objects", icon="TRASH")
        if properties.project:
            _draw_project(layout, context.scene)


def _draw_status(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """Draw one row, always, so that the buttons below stay where they are. The panel *Progress* has the details.

    A job that runs hides all else; what asks the user to act comes before what is only told.
    """
    current, waiting = job_runner.current(), job_runner.waiting()
    row = layout.row(align=True)
    if current is not None and current[1].running:
        row.progress(factor=current[1].fraction, text=_running_text(*current))
        row.operator("heritage.cancel_job", text="", icon="CANCEL")
        return
    stopped = job_runner.stopped(scene)
    state = current[1] if current is not None and job_runner.belongs_to(current[0], scene) else None
    if stopped:
        number = stopped[0][0]
        row = row.split(factor=_STATUS_SHARE, align=True)
        # Its name has no room beside the button; the panel Progress has it.
        row.label(text="Stopped", icon="ERROR")
        row.operator("heritage.continue_job", text="Continue").number = number
    elif waiting:
        row.label(text=_waiting_text(), icon="SORTTIME")
    elif state is not None and state.error_type == "PromptError":
        row.label(text="Not found, see Objects", icon="QUESTION")
    elif problems_of(scene):
        row.label(text="Something is wrong, see Progress", icon="ERROR")
    elif job_runner.undecided():
        row.label(text="Done, see Progress", icon="QUESTION")
    elif state is None:
        row.label(text="Ready", icon="CHECKMARK")
    else:
        row.label(text="Done", icon="CHECKMARK")


def _running_text(job: Job, state: JobState) -> str:
    if job_runner.waiting():
        # Both have no room in a sidebar of the usual width; the panel Progress has the stage.
        return f"{state.fraction:.0%}   {_waiting_text()}"
    # The engine needs seconds until it begins with a stage.
    return progress_text(state) if state.stage else job_name(job.kind, Path(job.subject), job.command)


def _waiting_text() -> str:
    waiting = job_runner.waiting()
    names = [job_name(one.kind, one.subject, one.command) for one in waiting]
    return translated("+{} waiting: {}", len(names), ", ".join(names))


def _draw_project(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    properties: HeritageScene = scene.heritage
    project = project_of(properties)
    layout.label(text=project.name, icon="FILE_3D")
    if is_missing(properties):
        sentence = translated("The project {} is missing. Choose the folder that it is in now.", str(project))
        draw_text(layout, sentence, icon="ERROR")
        layout.operator("heritage.find_project", icon="VIEWZOOM")
        return
    if is_open_elsewhere(project):
        draw_text(
            layout, "Another Blender has this project open. What both store, only the later one keeps.", icon="ERROR"
        )
    if properties.camera_colour in _HEALTH_ICONS:
        draw_text(layout, properties.camera_health, icon=_HEALTH_ICONS[properties.camera_colour])
    row = layout.row(align=True)
    row.operator("heritage.show_folder", text="Folder", icon="FILE_FOLDER")
    if report_file(project).is_file():
        row.operator("heritage.open_report", text="Report", icon="TEXT")
    better = better_preset(project)
    if better:
        # A preview is only a first look: its next step is one button.
        label = translated("Improve to {}", translated(better.capitalize()))
        layout.operator("heritage.improve_scene", text=label, icon="SHADERFX").preset = better
    for name in ("show", "blending"):
        # Without its name, a pair of switches does not say what it switches.
        column = layout.column(align=True)
        column.label(text=properties.bl_rna.properties[name].name)
        column.row().prop(properties, name, expand=True)
    row = layout.row(align=True)
    row.operator("heritage.look_through_photo", text="", icon="TRIA_LEFT").step = -1
    row.operator("heritage.look_through_photo", text=current_photo(scene) or "Look Through Photo")
    row.operator("heritage.look_through_photo", text="", icon="TRIA_RIGHT").step = 1
    if current_photo(scene) and any(scene.camera.data.background_images):
        layout.prop(properties, "photo_opacity", slider=True)


CLASSES = [HERITAGE_PT_scene]
