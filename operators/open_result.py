"""Open a finished result that fits no scene of this file, or leave it in its project."""

from __future__ import annotations

from typing import Annotated

import bpy
from bpy.props import IntProperty

from ..gaussian_heritage_addon.blender.typed_properties import blender_properties
from ..gaussian_heritage_addon.jobs import job_runner

__all__ = ["CLASSES"]


@blender_properties
class HERITAGE_OT_open_result(bpy.types.Operator):
    """Open the result in the scene that shows its project, or in a new one. Other projects are not changed"""

    bl_idname = "heritage.open_result"
    bl_label = "Open Result"

    number: Annotated[int, IntProperty(name="Number", min=0, options={"SKIP_SAVE"})]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import the result."""
        job_runner.take_in(self.number)
        return {"FINISHED"}


@blender_properties
class HERITAGE_OT_dismiss_result(bpy.types.Operator):
    """Leave the result in its project. Open Project shows it later"""

    bl_idname = "heritage.dismiss_result"
    bl_label = "Leave Result"

    number: Annotated[int, IntProperty(name="Number", min=0, options={"SKIP_SAVE"})]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Do not ask any more."""
        job_runner.dismiss(self.number)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_open_result, HERITAGE_OT_dismiss_result]
