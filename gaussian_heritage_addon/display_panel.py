"""The panel *Display*: how the viewports show the splats, and which objects."""

from __future__ import annotations

import bpy

from .native_splats import is_native
from .properties import heritage_objects

__all__ = ["CLASSES"]


class HERITAGE_PT_display(bpy.types.Panel):
    """How the viewports show the splats."""

    bl_label = "Display"
    bl_idname = "HERITAGE_PT_display"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Heritage"
    bl_order = 1

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether there are splats in the scene."""
        return bool(heritage_objects(context.scene))

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout, settings = self.layout, context.scene.heritage_display
        layout.row().prop(settings, "kind", expand=True)
        if settings.kind != "SHAPES":
            column = layout.column(align=True)
            column.prop(settings, "share", slider=True)
            column.prop(settings, "lighter")
        if is_native():
            layout.operator("heritage.copy_as_native")


CLASSES = [HERITAGE_PT_display]
