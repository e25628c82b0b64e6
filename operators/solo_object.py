"""Show one object alone."""

from __future__ import annotations

import bpy

from ..gaussian_heritage_addon.splats.object_meshes import hide_meshes
from ..gaussian_heritage_addon.splats.properties import apply_visibility
from ..gaussian_heritage_addon.splats.selection import heritage_objects, view_layer_of
from .project_operator import listed_object


class HERITAGE_OT_solo_object(bpy.types.Operator):
    """Hide all objects but the one selected in the list, with their meshes; again: show all but the background"""

    bl_idname = "heritage.solo_object"
    bl_label = "Solo"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Hide the others, or show them."""
        scene = context.scene
        chosen = listed_object(scene)
        objects = heritage_objects(scene, "OBJECT")
        is_alone = not chosen.heritage.hidden and all(obj.heritage.hidden for obj in objects if obj != chosen)
        for obj in objects:
            obj.heritage.hidden = obj != chosen and (not is_alone or obj.heritage.kind == "background")
            hide_meshes(obj, view_layer_of(scene), hidden=obj.heritage.hidden)
        scene.heritage.show = "OBJECTS"
        apply_visibility(scene)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_solo_object]
