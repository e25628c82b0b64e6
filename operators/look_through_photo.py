"""Look through the camera of a photo."""

from __future__ import annotations

import bpy

from ..engine.errors import HeritageError
from ..gaussian_heritage_addon.cameras import look_through

__all__ = ["CLASSES"]


class HERITAGE_OT_look_through_photo(bpy.types.Operator):
    """Make the camera of a photo the active one, with the photo's size for renders"""

    bl_idname = "heritage.look_through_photo"
    bl_label = "Look Through Photo"
    bl_options = {"REGISTER", "UNDO"}

    photo: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Photo",
        description="Its name; empty: the one looked through now, else the first",
        options={"SKIP_SAVE"},
    )
    longest_side: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Longest Side", description="Pixels of a render's longest side; 0: as the photo", min=0
    )
    step: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Step", description="So many photos further, by name", options={"SKIP_SAVE"}
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set camera and size."""
        try:
            look_through(context.scene, self.photo, self.longest_side, step=self.step)
        except HeritageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        # Absent where there is no window: from a script, or the button of another editor.
        if context.region_data is not None:
            context.region_data.view_perspective = "CAMERA"
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_look_through_photo]
