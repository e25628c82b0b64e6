"""The tab *Heritage* of the sidebar (N): the project, its running job, display options and training curve."""

from __future__ import annotations

import bpy

from . import job_runner, objects_panel, problems
from .cameras import current_photo
from .curve import stored_curve
from .layouts import draw_curve, draw_job, draw_text
from .properties import HeritageScene, project_of
from .set_up_box import draw_set_up

__all__ = ["CLASSES"]


class HERITAGE_PT_scene(bpy.types.Panel):
    """The project, its running job and display options."""

    bl_label = "Gaussian Heritage"
    bl_idname = "HERITAGE_PT_scene"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Heritage"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout = self.layout
        properties: HeritageScene = context.scene.heritage
        if draw_set_up(layout):
            return
        current = job_runner.current()
        if current is not None and current[0].kind in ("reconstruct", "segment"):
            draw_job(layout, *current)
        for problem in (job_runner.problem(), problems.shown()):
            if problem:
                draw_text(layout, problem, icon="ERROR")
        layout.operator("heritage.import_photo_folder", icon="IMAGE_DATA")
        layout.operator("heritage.open_project", icon="FILE_FOLDER")
        if properties.project:
            layout.label(text=properties.project)
            layout.prop(properties, "show", expand=True)
            layout.prop(properties, "blending")
            row = layout.row(align=True)
            row.operator("heritage.look_through_photo", text="", icon="TRIA_LEFT").step = -1
            row.operator("heritage.look_through_photo", text=current_photo(context.scene) or "Look Through Photo")
            row.operator("heritage.look_through_photo", text="", icon="TRIA_RIGHT").step = 1
            if current_photo(context.scene) and any(context.scene.camera.data.background_images):
                layout.prop(properties, "photo_opacity", slider=True)


class HERITAGE_PT_training(bpy.types.Panel):
    """Error against run time of the finished training."""

    bl_label = "Error against Run Time"
    bl_idname = "HERITAGE_PT_training"
    bl_parent_id = "HERITAGE_PT_scene"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the project has a training curve."""
        return bool(context.scene.heritage.project) and bool(stored_curve(project_of(context.scene.heritage)))

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        project = project_of(context.scene.heritage)
        draw_curve(self.layout, f"the training in {project}", stored_curve(project))


CLASSES = [HERITAGE_PT_scene, HERITAGE_PT_training, *objects_panel.CLASSES]
