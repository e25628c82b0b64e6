"""Remove a job that waits for the running one."""

from __future__ import annotations

from typing import Annotated

import bpy
from bpy.props import IntProperty

from ..gaussian_heritage_addon.blender.typed_properties import blender_properties
from ..gaussian_heritage_addon.jobs import job_runner

__all__ = ["CLASSES"]


@blender_properties
class HERITAGE_OT_drop_job(bpy.types.Operator):
    """Do not start this job"""

    bl_idname = "heritage.drop_job"
    bl_label = "Remove from Queue"

    number: Annotated[int, IntProperty(name="Number", min=0, options={"SKIP_SAVE"})]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove the job."""
        job_runner.drop(self.number)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_drop_job]
