"""Train isolated objects on the photos themselves, so that they become as sharp as the photos."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty

from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.splats.selection import heritage_objects
from .project_operator import listed_object, require_stored
from .segmenting import SegmentOperator


@call_properties
class HERITAGE_OT_add_detail(SegmentOperator):
    """Train the object on the photos at their own resolution, to make it as sharp as they are. The scene stays"""

    bl_idname = "heritage.add_detail"
    bl_label = "Add Detail"

    every: bool = BoolProperty(
        name="All Objects",
        description="Add detail to every object of the scene, not only to the one selected in the list",
    )

    loads_sam = False

    def segment_arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments for the selected object or for all."""
        if self.every:
            require_stored(heritage_objects(context.scene, "OBJECT"))
            return ["--detail"]
        obj = listed_object(context.scene)
        require_stored([obj])
        return [f"--detail={obj.heritage.object_id}"]


CLASSES = [HERITAGE_OT_add_detail]
