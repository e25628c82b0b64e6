"""The N-panel *Heritage*: the job, the prompt, the objects with their sliders and records, export."""

from __future__ import annotations

import bpy

from . import job_runner
from .jobs import JobState

__all__ = ["CLASSES"]


class HERITAGE_UL_objects(bpy.types.UIList):
    """The isolated objects with name, confidence and threshold."""

    bl_idname = "HERITAGE_UL_objects"

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):  # type: ignore[no-untyped-def]
        """Draw one object."""
        row = layout.row(align=True)
        row.prop(item, "name", text="", emboss=False, icon="OUTLINER_OB_POINTCLOUD")
        row.label(text=f"{item.heritage.score:.2f}")
        row.prop(item.heritage, "threshold", text="", slider=True)

    def filter_items(self, context, data, property):  # type: ignore[no-untyped-def]
        """Leave out everything that is not an isolated object of this scene."""
        ours = {obj.name for obj in context.scene.objects if obj.heritage.role == "OBJECT"}
        items = getattr(data, property)
        return [self.bitflag_filter_item if item.name in ours else 0 for item in items], []


class _HeritagePanel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Heritage"


class HERITAGE_PT_scene(_HeritagePanel, bpy.types.Panel):
    """The project, the job that works on it, and how it is shown."""

    bl_label = "Gaussian Heritage"
    bl_idname = "HERITAGE_PT_scene"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout, said = self.layout, context.scene.heritage
        running = job_runner.current()
        if running is not None:
            _draw_job(layout.box(), running[0].subject, running[1])
        if job_runner.problem():
            layout.label(text=job_runner.problem(), icon="ERROR")
        layout.operator("heritage.import_photo_folder", icon="IMAGE_DATA")
        layout.operator("heritage.open_project", icon="FILE_FOLDER")
        if said.project:
            layout.label(text=said.project)
            layout.prop(said, "show", expand=True)
            layout.prop(said, "blending")
            layout.operator("heritage.look_through_photo", icon="CAMERA_DATA")


def _draw_job(box: bpy.types.UILayout, subject: str, state: JobState) -> None:
    if state.running:
        box.label(text=state.message or subject)
        box.progress(factor=state.fraction, text=state.line())
        for name, value in state.metrics.items():
            box.label(text=f"{name}: {value:.4g}")
        box.operator("heritage.cancel_job", icon="CANCEL")
    elif state.error:
        box.label(text=state.error, icon="ERROR")
    else:
        box.label(text=state.message or "Done.", icon="CHECKMARK")
    for warning in state.warnings[-3:]:
        box.label(text=warning, icon="INFO")


class HERITAGE_PT_objects(_HeritagePanel, bpy.types.Panel):
    """Isolating objects, and what belongs to each."""

    bl_label = "Objects"
    bl_idname = "HERITAGE_PT_objects"

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
        layout.template_list("HERITAGE_UL_objects", "", bpy.data, "objects", said, "active")
        if 0 <= said.active < len(bpy.data.objects):
            _draw_record(layout, bpy.data.objects[said.active])
        layout.operator("heritage.export_objects", icon="EXPORT")


def _draw_record(layout: bpy.types.UILayout, obj: bpy.types.Object) -> None:
    said = obj.heritage
    if said.role != "OBJECT":
        return
    column = layout.column()
    for name in ("threshold", "catalogue_number", "title", "rights", "notes"):
        column.prop(said, name)
    if said.record_problem:
        column.label(text=said.record_problem, icon="ERROR")


CLASSES = [HERITAGE_UL_objects, HERITAGE_PT_scene, HERITAGE_PT_objects]
