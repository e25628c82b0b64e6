"""Stop the running job. Finished work is kept."""

from __future__ import annotations

import bpy

from ..gaussian_heritage_addon.jobs import job_runner


class HERITAGE_OT_cancel_job(bpy.types.Operator):
    """Stop the running job. What is finished is kept, and Continue goes on from there"""

    bl_idname = "heritage.cancel_job"
    bl_label = "Cancel"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Stop the job."""
        job_runner.cancel()
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_cancel_job]
