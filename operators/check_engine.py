"""Preferences > Check: check that the engine's Python has everything the engine needs."""

from __future__ import annotations

import bpy

from ..gaussian_heritage_addon.jobs import job_runner


class HERITAGE_OT_check_engine(bpy.types.Operator):
    """Check that the engine's Python has everything the engine needs"""

    bl_idname = "heritage.check_engine"
    bl_label = "Check"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the check."""
        state = job_runner.start("doctor", job_runner.ENGINE, "doctor")
        self.report({"INFO"}, "Checking in the background." if state is None else state.message)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_check_engine]
