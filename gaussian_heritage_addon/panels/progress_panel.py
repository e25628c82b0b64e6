"""The panel *Progress*: the running job, those that wait or were stopped, finished results, and problems."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...engine.workers.jobs import Job, JobState
from ..blender import problems
from ..blender.drawn_text import draw_text
from ..jobs import job_runner, scene_question
from ..jobs.job_names import job_name
from ..jobs.results import PROJECT_KINDS
from ..language.translations import translated
from .job_box import draw_job
from .question_box import draw_question
from .set_up_box import SET_UP_KINDS
from .sidebar import SidebarPanel


class HERITAGE_PT_progress(SidebarPanel):
    """The running job with its preview and curve, and the jobs that wait. Below all buttons, as its height changes."""

    bl_label = "Progress"
    bl_idname = "HERITAGE_PT_progress"
    bl_order = 2

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether there is anything to tell about jobs."""
        scene = context.scene
        jobs = (_shown_job() is not None, job_runner.waiting(), job_runner.stopped(scene), job_runner.undecided())
        return any(jobs) or scene_question.shown() is not None or bool(problems_of(scene))

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        scene = context.scene
        for problem in problems_of(scene):
            draw_text(self.layout, problem, icon="ERROR")
        for number, job, state in job_runner.stopped(scene):
            _draw_stopped(self.layout.box(), number, job, state)
        _draw_undecided(self.layout, is_new_scene=not scene.heritage.project)
        shown = _shown_job()
        if shown is not None:
            # The bar stands in the first row of the tab.
            draw_job(self.layout, *shown, bar=False)
        question = scene_question.shown()
        if question is not None and (shown is None or Path(shown[0].subject) != question.project):
            # Its job was stopped, or another one is shown.
            draw_question(self.layout.box(), question)
        for number, one in enumerate(job_runner.waiting()):
            row = self.layout.row(align=True)
            name = job_name(one.kind, one.subject, one.command)
            row.label(text=translated("Then: {} ({})", name, one.subject.name), icon="SORTTIME")
            row.operator("heritage.drop_job", text="", icon="X").number = number


def _draw_undecided(layout: bpy.types.UILayout, *, is_new_scene: bool) -> None:
    for number, project in enumerate(job_runner.undecided()):
        box = layout.box()
        if job_runner.ended_while_away(number):
            draw_text(box, translated("A job on {} ended while you were away.", project.name), icon="TIME", n_boxes=1)
        if not is_new_scene:
            sentence = translated("The result of {} is ready. This scene shows another project.", project.name)
            draw_text(box, sentence, icon="QUESTION", n_boxes=1)
        row = box.row(align=True)
        row.operator("heritage.open_result", text="Open" if is_new_scene else "Open in Own Scene").number = number
        row.operator("heritage.dismiss_result", text="Leave").number = number


def _draw_stopped(box: bpy.types.UILayout, number: int, job: Job, state: JobState) -> None:
    stopped = translated("Stopped: {}", job_name(job.kind, Path(job.subject), job.command))
    draw_text(box, stopped, icon="ERROR", n_boxes=1)
    draw_text(box, state.error, n_boxes=1)
    if state.error_type == "ModelFileError":
        # The engine names its command line.
        draw_text(
            box, "In Blender: Repair Engine, or Fetch beside the model, in Preferences > Add-ons > Gaussian Heritage.",
            n_boxes=1,
        )  # fmt: skip
    row = box.row(align=True)
    row.operator("heritage.continue_job", text="Continue", icon="PLAY").number = number
    row.operator("heritage.leave_job", text="Leave").number = number


def _shown_job() -> tuple[Job, JobState] | None:
    current = job_runner.current()
    return current if current is not None and current[0].kind in PROJECT_KINDS and not current[1].error else None


def problems_of(scene: bpy.types.Scene) -> list[str]:
    """Return what is wrong, apart from stopped jobs."""
    found = [job_runner.problem(), problems.shown()]
    current = job_runner.current()
    told_elsewhere = (*PROJECT_KINDS, *SET_UP_KINDS)
    if current is not None and current[0].kind not in told_elsewhere and current[1].error not in found:
        found.append(current[1].error)
    return [problem for problem in found if problem]


CLASSES = [HERITAGE_PT_progress]
