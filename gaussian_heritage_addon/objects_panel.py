"""The panel *Objects*: isolating by text and click, what was not found, and each object with sliders and record."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..engine.errors import HeritageError
from .candidates import NotFound, read_not_found
from .layouts import say
from .pictures import picture_icon
from .properties import active_object, heritage_objects

__all__ = ["CLASSES"]


class HERITAGE_UL_objects(bpy.types.UIList):
    """The isolated objects with name, confidence and threshold."""

    bl_idname = "HERITAGE_UL_objects"

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):  # type: ignore[no-untyped-def]
        """Draw one object."""
        row = layout.row(align=True)
        background = item.heritage.kind == "background"
        row.prop(item, "name", text="", emboss=False, icon="WORLD" if background else "OUTLINER_OB_POINTCLOUD")
        row.label(text="" if background else f"{item.heritage.score:.2f}")
        row.prop(item.heritage, "threshold", text="", slider=True)

    def filter_items(self, context, data, property):  # type: ignore[no-untyped-def]
        """Leave out everything that is not an isolated object of this scene."""
        ours = {obj.name for obj in heritage_objects(context.scene, "OBJECT")}
        items = getattr(data, property)
        return [self.bitflag_filter_item if item.name in ours else 0 for item in items], []


class HERITAGE_PT_objects(bpy.types.Panel):
    """Isolating objects, and what belongs to each."""

    bl_label = "Objects"
    bl_idname = "HERITAGE_PT_objects"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Heritage"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only where a project is open."""
        return bool(context.scene.heritage.project)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout, said = self.layout, context.scene.heritage
        row = layout.row(align=True)
        row.prop(said, "prompt", text="")
        row.operator("heritage.isolate", text="Isolate", icon="VIEWZOOM").prompt = said.prompt
        row = layout.row(align=True)
        row.operator("heritage.click_object", text="Click Object", icon="EYEDROPPER").refine = False
        row.operator("heritage.find_objects", icon="OUTLINER_OB_GROUP_INSTANCE")
        row.operator("heritage.isolate_background", icon="WORLD")
        try:
            not_found = read_not_found(Path(said.project))
        except HeritageError as error:
            say(layout, str(error), icon="ERROR")
        else:
            if not_found is not None:
                _draw_not_found(layout.box(), not_found)
        layout.template_list("HERITAGE_UL_objects", "", bpy.data, "objects", said, "active")
        obj = active_object(context.scene)
        if obj is not None:
            _draw_object(layout, obj)
        layout.operator("heritage.export_objects", icon="EXPORT")


def _draw_not_found(box: bpy.types.UILayout, not_found: NotFound) -> None:
    row = box.row()
    row.label(text="Not found", icon="QUESTION")
    row.operator("heritage.dismiss_candidates", text="", icon="X", emboss=False)
    for message in not_found.messages:
        say(box, message)
    if not_found.candidates:
        box.label(text="What came nearest:")
    for candidate in not_found.candidates:
        row = box.row()
        icon = picture_icon(candidate.picture)
        if icon:
            row.template_icon(icon_value=icon, scale=4.0)
        column = row.column()
        column.label(text=f"{candidate.text}? {candidate.score:.2f}")
        column.label(text=candidate.photo)
        column.operator("heritage.accept_candidate", text="Isolate").number = candidate.number


def _draw_object(layout: bpy.types.UILayout, obj: bpy.types.Object) -> None:
    said = obj.heritage
    column = layout.column()
    column.prop(said, "threshold", slider=True)
    if said.n_levels > 1:
        row = column.row(align=True)
        row.prop(said, "part_to_whole", text=f"Part to Whole: {said.level + 1} of {said.n_levels}", slider=True)
        if said.level != said.stored_level:
            row.operator("heritage.refine_object", text="Keep").level = said.level
    if said.kind != "background":
        column.operator("heritage.click_object", text="Correct by Clicks", icon="EYEDROPPER").refine = True
    for name in ("catalogue_number", "title", "rights", "notes"):
        column.prop(said, name)
    if said.problem:
        say(column, said.problem, icon="ERROR")


CLASSES = [HERITAGE_UL_objects, HERITAGE_PT_objects]
