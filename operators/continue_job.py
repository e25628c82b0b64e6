"""Start a stopped or failed job again, which continues with the work that is finished; or leave it."""

from __future__ import annotations

from typing import Annotated

import bpy
from bpy.props import IntProperty

from ..gaussian_heritage_addon.blender.typed_properties import blender_properties
from ..gaussian_heritage_addon.jobs import job_runner

__all__ = ["CLASSES"]


@blender_properties
class HERITAGE_OT_continue_job(bpy.types.Operator):
    """Start the stopped job again. It continues with the work that is finished"""

    bl_idname = "heritage.continue_job"
    bl_label = "Continue"

    number: Annotated[int, IntProperty(name="Number", min=0, options={"SKIP_SAVE"})]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the job."""
        job_runner.continue_stopped(self.number)
        return {"FINISHED"}


@blender_properties
class HERITAGE_OT_leave_job(bpy.types.Operator):
    """Do not offer to continue this job any more. Its finished work stays in the project"""

    bl_idname = "heritage.leave_job"
    bl_label = "Leave Stopped Job"

    number: Annotated[int, IntProperty(name="Number", min=0, options={"SKIP_SAVE"})]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Leave the job."""
        job_runner.leave_stopped(self.number)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_continue_job, HERITAGE_OT_leave_job]
