"""Train isolated objects on the photos themselves, so that they become as sharp as the photos."""

from __future__ import annotations

from typing import Annotated

import bpy
from bpy.props import BoolProperty

from ..engine.core.errors import ObjectError
from ..gaussian_heritage_addon.blender.typed_properties import blender_properties
from ..gaussian_heritage_addon.project.hand_edits import edited_objects
from ..gaussian_heritage_addon.splats.properties import active_object
from .segmenting import SegmentOperator

__all__ = ["CLASSES"]


@blender_properties
class HERITAGE_OT_add_detail(SegmentOperator):
    """Train the object on the photos at their own resolution, to make it as sharp as they are. The scene stays"""

    bl_idname = "heritage.add_detail"
    bl_label = "Add Detail"

    every: Annotated[
        bool,
        BoolProperty(
            name="All Objects",
            description="Add detail to every object of the scene, not only to the one selected in the list",
            options={"SKIP_SAVE"},
        ),
    ]

    loads_sam = False

    def segment_arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments for the selected object or for all."""
        obj = active_object(context.scene)
        if not self.every and (obj is None or not obj.heritage.object_id):
            raise ObjectError("Select an isolated object in the list first.")
        for edited in edited_objects(context.scene):
            if self.every or edited == obj:
                raise ObjectError(f"{edited.name} was edited by hand. Store its edits first, or undo them.")
        return ["--detail"] if self.every or obj is None else [f"--detail={obj.heritage.object_id}"]


CLASSES = [HERITAGE_OT_add_detail]
