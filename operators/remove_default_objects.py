"""Delete the cube and the light of a new Blender file, which stand in the middle of an imported scene."""

from __future__ import annotations

import bpy

from ..gaussian_heritage_addon.blender.default_objects import untouched_defaults


class HERITAGE_OT_remove_default_objects(bpy.types.Operator):
    """Delete the cube and the light that every new Blender file has; only as long as nobody changed them"""

    bl_idname = "heritage.remove_default_objects"
    bl_label = "Remove Default Cube and Light"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Delete them."""
        for obj in untouched_defaults(context.scene):
            bpy.data.objects.remove(obj)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_remove_default_objects]
