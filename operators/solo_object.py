"""Show one object alone."""

from __future__ import annotations

import bpy

from ..engine.core.errors import ObjectError
from ..gaussian_heritage_addon.splats.properties import active_object, apply_visibility, heritage_objects

__all__ = ["CLASSES"]


class HERITAGE_OT_solo_object(bpy.types.Operator):
    """Hide all objects but the one selected in the list; again: show all but the background"""

    bl_idname = "heritage.solo_object"
    bl_label = "Solo"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Hide the others, or show them."""
        scene = context.scene
        chosen = active_object(scene)
        if chosen is None:
            raise ObjectError("No object is selected. Select one in the list.")
        objects = heritage_objects(scene, "OBJECT")
        is_alone = not chosen.heritage.hidden and all(obj.heritage.hidden for obj in objects if obj != chosen)
        for obj in objects:
            obj.heritage.hidden = obj != chosen and (not is_alone or obj.heritage.kind == "background")
        scene.heritage.show = "OBJECTS"
        apply_visibility(scene)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_solo_object]
