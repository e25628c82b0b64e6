"""Select an isolated object in the list and in the view."""

from __future__ import annotations

import bpy
from bpy.props import StringProperty

from ..engine.core.errors import ObjectError
from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.project.new_objects import show_new_objects
from ..gaussian_heritage_addon.splats.selection import heritage_objects


@call_properties
class HERITAGE_OT_select_object(bpy.types.Operator):
    """Select this object in the list, and look at it"""

    bl_idname = "heritage.select_object"
    bl_label = "Select Object"

    object_id: str = StringProperty(name="Object", description="Id of the object in the project")

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Select and frame the object."""
        if all(obj.heritage.object_id != self.object_id for obj in heritage_objects(context.scene, "OBJECT")):
            raise ObjectError(f"This file has no object {self.object_id[:100]!r}. Open the project again.")
        context.scene.heritage.show = "OBJECTS"
        show_new_objects(context.scene, [self.object_id])
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_select_object]
