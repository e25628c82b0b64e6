"""Operators on the jobs and results that the panel lists, each by its number there."""

from __future__ import annotations

import bpy
from bpy.props import IntProperty

from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.jobs import job_runner


@call_properties
class _ListedOperator(bpy.types.Operator):
    """Base class: an operator on one entry of a list."""

    number: int = IntProperty(name="Number", min=0)


class HERITAGE_OT_continue_job(_ListedOperator):
    """Start the stopped job again. It continues with the work that is finished"""

    bl_idname = "heritage.continue_job"
    bl_label = "Continue"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the job."""
        job_runner.continue_stopped(self.number)
        return {"FINISHED"}


class HERITAGE_OT_leave_job(_ListedOperator):
    """Do not offer to continue this job any more. Its finished work stays in the project"""

    bl_idname = "heritage.leave_job"
    bl_label = "Leave Stopped Job"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Leave the job."""
        job_runner.leave_stopped(self.number)
        return {"FINISHED"}


class HERITAGE_OT_drop_job(_ListedOperator):
    """Do not start this job"""

    bl_idname = "heritage.drop_job"
    bl_label = "Remove from Queue"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remove the job."""
        job_runner.drop(self.number)
        return {"FINISHED"}


class HERITAGE_OT_open_result(_ListedOperator):
    """Open the result in the scene that shows its project, or in a new one. Other projects are not changed"""

    bl_idname = "heritage.open_result"
    bl_label = "Open Result"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import the result."""
        job_runner.take_in(self.number)
        return {"FINISHED"}


class HERITAGE_OT_dismiss_result(_ListedOperator):
    """Leave the result in its project. Open Project shows it later"""

    bl_idname = "heritage.dismiss_result"
    bl_label = "Leave Result"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Do not ask any more."""
        job_runner.dismiss(self.number)
        return {"FINISHED"}


CLASSES = [
    HERITAGE_OT_continue_job,
    HERITAGE_OT_leave_job,
    HERITAGE_OT_drop_job,
    HERITAGE_OT_open_result,
    HERITAGE_OT_dismiss_result,
]
