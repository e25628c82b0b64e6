"""Words asked of the scene so far, in a panel: the field, the question that is being answered, and the answer."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..blender.drawn_text import draw_text
from ..jobs import scene_question
from ..jobs.scene_question import Question
from ..language.translations import translated
from ..project.pictures import picture_icon
from ..splats.properties import HeritageScene

_PICTURE_SCALE = 8.0


def draw_asking(layout: bpy.types.UILayout, project: Path) -> None:
    """Draw the field for words while the scene of `project` is being trained, and what was asked of it last."""
    if scene_question.asked_project() == project:
        column = layout.column(align=True)
        column.label(text="What is in it?")
        row = column.row(align=True)
        properties: HeritageScene = bpy.context.scene.heritage
        row.prop(properties, "question", text="", placeholder="vase, teapot")
        row.operator("heritage.ask_scene", text="Ask", icon="VIEWZOOM").words = properties.question
    question = scene_question.shown()
    if question is not None and question.project == project:
        draw_question(layout, question)


def draw_question(layout: bpy.types.UILayout, question: Question) -> None:
    """Draw a question with its answer, as pictures and sentences, or with how far the engine is."""
    row = layout.row(align=True)
    if not question.is_over:
        text = translated("Looking for {} ...", question.words)
        row.progress(factor=question.job.poll().fraction, text=text)
        row.operator("heritage.cancel_question", text="", icon="CANCEL")
        return
    row.label(text=question.words, icon="VIEWZOOM", translate=False)
    row.operator("heritage.dismiss_answer", text="", icon="X")
    if question.answers is None:
        draw_text(layout, question.problem, icon="QUESTION", n_boxes=1)
        return
    for one in question.answers.found:
        icon = picture_icon(one.picture)
        if icon:
            layout.template_icon(icon_value=icon, scale=_PICTURE_SCALE)
        draw_text(layout, translated("{} in {}", one.text, one.photo), n_boxes=1)
    for reason in question.answers.refused.values():
        draw_text(layout, reason, icon="QUESTION", n_boxes=1)
    of_what = translated("The scene after step {} of its training. Nothing is stored.", question.answers.step)
    draw_text(layout, of_what, n_boxes=1)
