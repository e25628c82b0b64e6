"""Preferences > Remove: delete the engine that was set up from Blender."""

from __future__ import annotations

import sys

import bpy

from ..gaussian_heritage_addon.blender.folder_size import folder_bytes
from ..gaussian_heritage_addon.jobs import job_runner
from ..gaussian_heritage_addon.setup.installation import installed_engine, remove_command


class HERITAGE_OT_remove_engine(bpy.types.Operator):
    """Delete the engine's packages. Projects and model files are kept"""

    bl_idname = "heritage.remove_engine"
    bl_label = "Remove Engine"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for confirmation."""
        folder = installed_engine().folder
        size = folder_bytes(folder)
        amount = "" if size is None else f" ({size / 1e9:.1f} GB)"
        message = f"Delete {folder}{amount}? Projects and model files are kept; their folder is in the documentation."
        return context.window_manager.invoke_confirm(self, event, title="Remove Engine", message=message)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the removal."""
        state = job_runner.start_command(job_runner.REMOVAL, job_runner.ENGINE, remove_command(sys.executable))
        self.report({"INFO"}, "Removing in the background." if state is None else state.message)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_remove_engine]
