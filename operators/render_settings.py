"""Set a scene up to render splats, and take this back."""

from __future__ import annotations

import bpy

from ..gaussian_heritage_addon.splats.render_settings import restore_settings, set_up_render


class HERITAGE_OT_set_up_render(bpy.types.Operator):
    """Set Cycles, transparent bounces, samples, pixel filter and view transform of this scene to what splats need"""

    bl_idname = "heritage.set_up_render"
    bl_label = "Set Up Render"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set the scene up."""
        set_up_render(context.scene)
        return {"FINISHED"}


class HERITAGE_OT_restore_render(bpy.types.Operator):
    """Set the render settings back to what they were before splats came; what you changed since then stays"""

    bl_idname = "heritage.restore_render"
    bl_label = "Restore Render Settings"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Restore the settings."""
        restore_settings(context.scene)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_set_up_render, HERITAGE_OT_restore_render]
