"""Start the stopped or failed job again; it continues with the work that is finished."""

from __future__ import annotations

import bpy

from ..gaussian_heritage_addon import job_runner

__all__ = ["CLASSES"]


class HERITAGE_OT_continue_job(bpy.types.Operator):
    """Start the stopped job again. It continues with the work that is finished"""

    bl_idname = "heritage.continue_job"
    bl_label = "Continue"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the job."""
        job_runner.continue_last()
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_continue_job]
