"""Look through the camera of a photo."""

from __future__ import annotations

import bpy
from bpy.props import IntProperty, StringProperty

from ..gaussian_heritage_addon.blender.typed_properties import blender_properties
from ..gaussian_heritage_addon.project.cameras import look_through


@blender_properties
class HERITAGE_OT_look_through_photo(bpy.types.Operator):
    """Make the camera of a photo the active camera, and give renders the size of the photo"""

    bl_idname = "heritage.look_through_photo"
    bl_label = "Look Through Photo"
    bl_options = {"REGISTER", "UNDO"}

    photo: str = StringProperty(
        name="Photo",
        description="Name of the photo; empty: the current photo, or else the first",
        options={"SKIP_SAVE"},
    )
    longest_side: int = IntProperty(
        name="Longest Side", description="Longest side of a render in pixels; 0: that of the photo", min=0
    )
    step: int = IntProperty(name="Step", description="Number of photos to move on, by name", options={"SKIP_SAVE"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set the camera and the size of renders."""
        look_through(context.scene, self.photo, self.longest_side, step=self.step)
        # None in a script without a window, or in another editor.
        if context.region_data is not None:
            context.region_data.view_perspective = "CAMERA"
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_look_through_photo]
