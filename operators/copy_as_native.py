"""Copy the shown Gaussians as the type of Blender 5.3."""

from __future__ import annotations

import bpy

from ..engine.core.errors import ObjectError
from ..gaussian_heritage_addon.project.placement import placement_properties
from ..gaussian_heritage_addon.splats.native_splats import copy_as_native, is_native
from ..gaussian_heritage_addon.splats.properties import record_of
from ..gaussian_heritage_addon.splats.selection import heritage_objects
from ..gaussian_heritage_addon.splats.splats import SplatScene


class HERITAGE_OT_copy_as_native(bpy.types.Operator):
    """Copy the shown scene or objects as Gaussians of Blender's own type, for EEVEE and Cycles"""

    bl_idname = "heritage.copy_as_native"
    bl_label = "Copy as Blender's Gaussians"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Copy what is shown, as it stands in the scene."""
        if not is_native():
            raise ObjectError("This Blender has no type for Gaussians. Use Blender 5.3 or newer.")
        collection = bpy.data.collections.new("Blender's Gaussians")
        context.scene.collection.children.link(collection)
        for obj in heritage_objects(context.scene):
            if obj.visible_get():
                threshold = obj.heritage.threshold if obj.heritage.role == "OBJECT" else None
                copy = copy_as_native(obj.name, SplatScene.of(obj).gaussians(threshold), collection)
                # Its exported file states the unit and the record, as that of the object does.
                for key, value in placement_properties(obj).items():
                    copy[key] = value
                for name, value in record_of(obj).as_dict().items():
                    setattr(copy.heritage, name, value)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_copy_as_native]
