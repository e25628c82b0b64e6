"""The panel *Objects*: isolating objects, prompts that were not found, and the sliders and record of each object."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import bpy
from bpy.app.translations import pgettext_n

from ...engine.core.errors import HeritageError, ModelFileError
from ...engine.core.files import object_file
from ...engine.core.words import likeness
from ...engine.objects.settings import SURE_SCORE
from ...engine.project.objects import PICTURE_FILE
from ...engine.project.own_words import read_learning
from ...engine.project.refused_prompts import Candidate, NotFound, Refusal, read_not_found
from ..blender.drawn_text import draw_text
from ..language.translations import translated
from ..project.not_stored import draw_not_stored, is_unstored
from ..project.pictures import picture_icon
from ..setup.model_files import find_model, megabytes
from ..splats.properties import HeritageObject, HeritageScene, project_of
from ..splats.selection import active_object, heritage_objects
from .sidebar import ProjectPanel

_NAME_SHARE = 0.6
"""Share of the width of a row that the name of an object gets."""
_NEXT_STEP_HEIGHT = 1.6
_N_COLUMNS = 2
"""Pictures side by side of what a refused word may mean: three would have no room for their buttons."""
_MAX_MESSAGES = 3
"""Words that were not found, each with its sentence; all of them would push the objects out of sight."""


_LIKENESS = {
    "hardly": pgettext_n("Hardly looks like it"),
    "a little": pgettext_n("Looks a little like it"),
    "probably": pgettext_n("Probably: {}"),
    "clearly": pgettext_n("Clearly: {}"),
}
"""The words for a match, shown instead of a number."""


def _is_guess(properties: HeritageObject) -> bool:
    """Return whether the name may be wrong: "Find all" guesses names, and not every answer to a word is right."""
    return properties.kind == "all" or (properties.kind == "text" and properties.score < SURE_SCORE)


def _icon_of(properties: HeritageObject) -> str:
    if properties.kind == "background":
        return "WORLD"
    return "QUESTION" if _is_guess(properties) else "OUTLINER_OB_POINTCLOUD"


class HERITAGE_UL_objects(bpy.types.UIList):
    """List of the isolated objects with name, confidence and threshold."""

    bl_idname = "HERITAGE_UL_objects"

    def draw_item(
        self,
        context: bpy.types.Context,
        layout: bpy.types.UILayout,
        data: Any,
        item: bpy.types.Object,
        icon: int,
        active_data: Any,
        active_property: str,
        index: int = 0,
        flt_flag: int = 0,
    ) -> None:
        """Draw one object."""
        split = layout.split(factor=_NAME_SHARE, align=True)
        split.prop(item, "name", text="", emboss=False, icon=_icon_of(item.heritage))
        # Of a row, symbols take their own width only, and the number keeps its digits.
        row = split.row(align=True)
        row.prop(item.heritage, "threshold", text="", slider=True)
        if is_unstored(item):
            # Not as stored; below the list stands the button that stores it.
            row.label(text="", icon="FILE_TICK")
        eye = "HIDE_ON" if item.heritage.hidden else "HIDE_OFF"
        row.prop(item.heritage, "hidden", text="", icon=eye, emboss=False)

    def filter_items(self, context: bpy.types.Context, data: Any, property: str) -> tuple[list[int], list[int]]:
        """Show only the isolated objects of this scene, the background last."""
        isolated = {obj.name: obj.heritage.kind == "background" for obj in heritage_objects(context.scene, "OBJECT")}
        names = [item.name for item in getattr(data, property)]
        order = sorted(range(len(names)), key=lambda number: (isolated.get(names[number], False), number))
        places = [0] * len(names)
        for place, number in enumerate(order):
            places[number] = place
        return [self.bitflag_filter_item if name in isolated else 0 for name in names], places


class HERITAGE_PT_objects(ProjectPanel):
    """Isolating objects, and the properties of the selected object."""

    bl_label = "Objects"
    bl_idname = "HERITAGE_PT_objects"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout = self.layout
        properties: HeritageScene = context.scene.heritage
        column = layout.column(align=True)
        column.prop(properties, "prompt", text="", placeholder="vase, teapot")
        isolate = column.column()
        # Always: when a job brings the first objects, no button may move under the pointer.
        isolate.scale_y = _NEXT_STEP_HEIGHT
        isolate.operator("heritage.isolate", text="Isolate", icon="VIEWZOOM").prompt = properties.prompt
        column = layout.column(align=True)
        column.operator("heritage.click_object", text="Click Object", icon="EYEDROPPER").refine = False
        row = column.row(align=True)
        row.operator("heritage.find_objects", text="Find All")
        row.operator("heritage.isolate_background", text="Background")
        _draw_learning(column, project_of(properties))
        # Before what was not found, which would push the list out of sight.
        layout.template_list("HERITAGE_UL_objects", "", bpy.data, "objects", properties, "active")
        try:
            not_found = read_not_found(project_of(properties))
        except HeritageError as error:
            draw_text(layout, str(error), icon="ERROR")
        else:
            if not_found is not None:
                _draw_not_found(layout.box(), not_found, context.scene)
        obj = active_object(context.scene)
        if obj is not None:
            _draw_object(layout, obj)
        # Below the sliders: it appears while one is dragged, and would move it away under the pointer.
        draw_not_stored(layout, context.scene)
        export = layout.column()
        export.scale_y = _NEXT_STEP_HEIGHT
        export.operator("heritage.export_objects", text="Export Objects", icon="EXPORT")


def _draw_not_found(box: bpy.types.UILayout, not_found: NotFound, scene: bpy.types.Scene) -> None:
    names = {obj.heritage.object_id: obj.name for obj in heritage_objects(scene, "OBJECT")}
    row = box.row()
    row.label(text="Not found", icon="QUESTION")
    row.operator("heritage.dismiss_candidates", text="", icon="X", emboss=False)
    for refusal in not_found.refusals[:_MAX_MESSAGES]:
        draw_text(box, refusal.message, n_boxes=1)
        _draw_meant(box, refusal, names)
    if len(not_found.refusals) > _MAX_MESSAGES:
        box.label(text=translated("... and {} more", len(not_found.refusals) - _MAX_MESSAGES))
    if not_found.offer:
        _draw_offer(box, not_found.offer)
    if not_found.candidates:
        box.label(text="Is it one of these?")
    for text in dict.fromkeys(candidate.text for candidate in not_found.candidates):
        box.label(text=f"{text}?")
        grid = box.grid_flow(row_major=True, columns=_N_COLUMNS, even_columns=True, align=True)
        for candidate in (one for one in not_found.candidates if one.text == text):
            _draw_candidate(grid.column(align=True), candidate, names)


def _draw_candidate(column: bpy.types.UILayout, candidate: Candidate, names: dict[str, str]) -> None:
    """Draw a picture of what a word may mean, with the button that takes it."""
    icon = picture_icon(candidate.picture)
    if icon:
        column.template_icon(icon_value=icon, scale=4.0)
    if candidate.object_id in names:
        # Isolated again, it would stand twice in the list.
        column.label(text=translated("This is {}", names[candidate.object_id]))
        column.operator("heritage.select_object", text="Select").object_id = candidate.object_id
    else:
        column.operator("heritage.accept_candidate", text="This One").number = candidate.number


def _draw_learning(column: bpy.types.UILayout, project: Path) -> None:
    """Draw whether the project learns words as a box to tick; nothing for a project that cannot be read."""
    with contextlib.suppress(HeritageError):  # the panel of the project says what is wrong
        learns = read_learning(project)
        icon = "CHECKBOX_HLT" if learns else "CHECKBOX_DEHLT"
        column.operator("heritage.learn_words", text="Learn My Words", icon=icon, depress=learns)


def _draw_offer(box: bpy.types.UILayout, name: str) -> None:
    """Draw the button that fetches a model which knows more words; nothing for one that this version does not know."""
    with contextlib.suppress(ModelFileError):
        label = translated("Know Any Word ({}) ...", megabytes(find_model(name)))
        box.operator("heritage.know_any_word", text=label, icon="IMPORT")


def _draw_meant(box: bpy.types.UILayout, refusal: Refusal, names: dict[str, str]) -> None:
    """Draw what may have been meant as buttons: objects that are there, and words that can be searched for."""
    known = [object_id for object_id in refusal.object_ids if object_id in names]
    if not known and not refusal.suggestions:
        return
    box.label(text="Did you mean:")
    column = box.column(align=True)
    for object_id in known:
        text = translated("Select {}", names[object_id])
        column.operator("heritage.select_object", text=text, icon="RESTRICT_SELECT_OFF").object_id = object_id
    for word in refusal.suggestions:
        column.operator("heritage.isolate", text=translated("Isolate {}", word), icon="VIEWZOOM").prompt = word


def _draw_object(layout: bpy.types.UILayout, obj: bpy.types.Object) -> None:
    properties: HeritageObject = obj.heritage
    column = layout.column()
    column.prop(properties, "threshold", slider=True)
    if properties.n_levels > 1:
        column.prop(
            properties,
            "part_to_whole",
            text=translated("Part to Whole: {} of {}", properties.level + 1, properties.n_levels),
            slider=True,
        )
        if properties.level != properties.stored_level:
            # Below the slider: beside it, the slider that is being dragged would lose half its width, and its text.
            column.operator("heritage.refine_object", text="Keep").level = properties.level
    if properties.kind == "all":
        draw_text(column, "Its name is a guess: double-click it", icon="QUESTION")
    column.operator("heritage.solo_object", icon="SOLO_ON")
    if properties.kind != "background":
        column.operator("heritage.click_object", text="Correct by Clicks", icon="EYEDROPPER").refine = True
        row = column.row(align=True)
        row.operator("heritage.add_detail", text="Detail", icon="TEXTURE").every = False
        row.operator("heritage.add_detail", text="All Objects").every = True
        row = column.row(align=True)
        row.operator("heritage.make_mesh", text="Mesh", icon="MESH_DATA").watertight = False
        row.operator("heritage.make_mesh", text="Watertight").watertight = True
        if properties.kind == "text":
            _draw_likeness(column, properties)
    for name in ("catalogue_number", "title", "rights", "notes"):
        # Beside its name, a field would have no room in a sidebar of the usual width.
        column.prop(properties, name, text="", placeholder=properties.bl_rna.properties[name].name)
    if properties.problem:
        draw_text(column, properties.problem, icon="ERROR")


def _draw_likeness(column: bpy.types.UILayout, properties: HeritageObject) -> None:
    """Draw how sure the name of an object is that was found by words, with its picture where it may be wrong."""
    text = translated(_LIKENESS[likeness(properties.score, SURE_SCORE)], properties.prompt)
    if not _is_guess(properties):
        draw_text(column, text)
        return
    draw_text(column, text, icon="QUESTION")
    draw_text(column, "Look whether it is right; a double click in the list changes the name.")
    icon = 0
    if properties.project and properties.object_id:
        with contextlib.suppress(HeritageError):  # The panel itself says what is wrong with a project.
            icon = picture_icon(object_file(project_of(properties), properties.object_id, PICTURE_FILE))
    if icon:
        column.template_icon(icon_value=icon, scale=5.0)


CLASSES = [HERITAGE_UL_objects, HERITAGE_PT_objects]
