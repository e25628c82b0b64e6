"""The panel *Error against Run Time* of the finished training."""

from __future__ import annotations

import bpy

from ..project.curve import stored_curve
from ..splats.properties import project_of
from .job_box import draw_curve
from .sidebar import SidebarPanel


class HERITAGE_PT_training(SidebarPanel):
    """Error against run time of the finished training."""

    bl_label = "Error against Run Time"
    bl_idname = "HERITAGE_PT_training"
    bl_order = 3
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the project has a training curve."""
        return bool(context.scene.heritage.project) and bool(stored_curve(project_of(context.scene.heritage)))

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        project = project_of(context.scene.heritage)
        draw_curve(self.layout, f"the training in {project}", stored_curve(project))


CLASSES = [HERITAGE_PT_training]
