"""The panel *Objects*: isolating objects, prompts that were not found, and the sliders and record of each object."""

from __future__ import annotations

from typing import Any

import bpy

from ..engine.errors import HeritageError
from .candidates import NotFound, read_not_found
from .layouts import draw_text
from .pictures import picture_icon
from .properties import HeritageObject, HeritageScene, active_object, heritage_objects, project_of

__all__ = ["CLASSES"]


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
        row = layout.row(align=True)
        background = item.heritage.kind == "background"
        row.prop(item, "name", text="", emboss=False, icon="WORLD" if background else "OUTLINER_OB_POINTCLOUD")
        row.label(text="" if background else f"{item.heritage.score:.2f}")
        row.prop(item.heritage, "threshold", text="", slider=True)

    def filter_items(self, context: bpy.types.Context, data: Any, property: str) -> tuple[list[int], list[int]]:
        """Show only the isolated objects of this scene."""
        isolated = {obj.name for obj in heritage_objects(context.scene, "OBJECT")}
        items = getattr(data, property)
        return [self.bitflag_filter_item if item.name in isolated else 0 for item in items], []


class HERITAGE_PT_objects(bpy.types.Panel):
    """Isolating objects, and the properties of the selected object."""

    bl_label = "Objects"
    bl_idname = "HERITAGE_PT_objects"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Heritage"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether a project is open."""
        return bool(context.scene.heritage.project)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout = self.layout
        properties: HeritageScene = context.scene.heritage
        row = layout.row(align=True)
        row.prop(properties, "prompt", text="")
        row.operator("heritage.isolate", text="Isolate", icon="VIEWZOOM").prompt = properties.prompt
        row = layout.row(align=True)
        row.operator("heritage.click_object", text="Click Object", icon="EYEDROPPER").refine = False
        row.operator("heritage.find_objects", icon="OUTLINER_OB_GROUP_INSTANCE")
        row.operator("heritage.isolate_background", icon="WORLD")
        try:
            not_found = read_not_found(project_of(properties))
        except HeritageError as error:
            draw_text(layout, str(error), icon="ERROR")
        else:
            if not_found is not None:
                _draw_not_found(layout.box(), not_found)
        layout.template_list("HERITAGE_UL_objects", "", bpy.data, "objects", properties, "active")
        obj = active_object(context.scene)
        if obj is not None:
            _draw_object(layout, obj)
        layout.operator("heritage.export_objects", icon="EXPORT")


def _draw_not_found(box: bpy.types.UILayout, not_found: NotFound) -> None:
    row = box.row()
    row.label(text="Not found", icon="QUESTION")
    row.operator("heritage.dismiss_candidates", text="", icon="X", emboss=False)
    for message in not_found.messages:
        draw_text(box, message)
    if not_found.candidates:
        box.label(text="Closest matches:")
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
    properties: HeritageObject = obj.heritage
    column = layout.column()
    column.prop(properties, "threshold", slider=True)
    if properties.n_levels > 1:
        row = column.row(align=True)
        row.prop(
            properties,
            "part_to_whole",
            text=f"Part to Whole: {properties.level + 1} of {properties.n_levels}",
            slider=True,
        )
        if properties.level != properties.stored_level:
            row.operator("heritage.refine_object", text="Keep").level = properties.level
    if properties.kind != "background":
        column.operator("heritage.click_object", text="Correct by Clicks", icon="EYEDROPPER").refine = True
    for name in ("catalogue_number", "title", "rights", "notes"):
        column.prop(properties, name)
    if properties.problem:
        draw_text(column, properties.problem, icon="ERROR")


CLASSES = [HERITAGE_UL_objects, HERITAGE_PT_objects]
