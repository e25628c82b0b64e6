"""The panel *Display*: how the viewports show the splats, and which objects."""

from __future__ import annotations

import bpy

from ..blender.drawn_text import draw_text
from ..language.translations import translated
from ..splats.native_splats import is_native
from ..splats.properties import view_transform_of
from ..splats.render_settings import can_restore, missing_settings
from ..splats.selection import heritage_objects
from .sidebar import SidebarPanel


class HERITAGE_PT_display(SidebarPanel):
    """How the viewports show the splats."""

    bl_label = "Display"
    bl_idname = "HERITAGE_PT_display"
    bl_order = 1

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether there are splats in the scene, or settings that were made for them."""
        return bool(heritage_objects(context.scene)) or can_restore(context.scene)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout, settings = self.layout, context.scene.heritage_display
        if can_restore(context.scene):
            draw_text(layout, "The render settings are still those for splats.", icon="INFO")
            layout.operator("heritage.restore_render")
            return
        layout.row().prop(settings, "kind", expand=True)
        if settings.kind != "SHAPES":
            column = layout.column(align=True)
            column.prop(settings, "share", slider=True)
            column.prop(settings, "lighter")
        if is_native():
            layout.operator("heritage.copy_as_native")
        _draw_missing(layout, context.scene)


def _draw_missing(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    missing = missing_settings(scene)
    if not missing:
        return
    names = {
        "engine": "Cycles",
        "transparent_bounces": translated("256 transparent bounces"),
        "view_transform": translated("view transform {}", view_transform_of(scene)),
        "samples": translated("1 sample"),
    }
    listed = ", ".join(names[one] for one in missing)
    draw_text(layout, translated("A render of splats needs: {}", listed), icon="INFO")
    layout.operator("heritage.set_up_render")


CLASSES = [HERITAGE_PT_display]
