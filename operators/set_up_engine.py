"""Set up, repair or update the engine's Python environment, after showing its size, place and licences."""

from __future__ import annotations

import sys

import bpy

from ..gaussian_heritage_addon.blender.drawn_text import draw_text
from ..gaussian_heritage_addon.jobs import job_runner
from ..gaussian_heritage_addon.setup.installation import describe, install_command
from ..gaussian_heritage_addon.setup.preferences import set_up_options

_DIALOG_WIDTH, _DIALOG_LINE_LENGTH = 560, 85
"""Width of the dialog in pixels at the default interface scale, and the number of characters that fit a line."""


class HERITAGE_OT_set_up_engine(bpy.types.Operator):
    """Install what reconstructs scenes: Python packages and model files. Continues a set-up that was stopped"""

    bl_idname = "heritage.set_up_engine"
    bl_label = "Set Up Engine"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Show size, place and licences, and ask for confirmation."""
        self._command()
        return context.window_manager.invoke_props_dialog(self, width=_DIALOG_WIDTH, confirm_text="Set Up")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the dialog."""
        _, build, bundle = set_up_options()
        for line in describe(build, bundle):
            draw_text(self.layout, line, line_length=_DIALOG_LINE_LENGTH)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the installation."""
        state = job_runner.start_command("set-up", job_runner.ENGINE, self._command())
        message = "Setting up in the background; see the Heritage panel." if state is None else state.message
        self.report({"INFO"}, message)
        return {"FINISHED"}

    @staticmethod
    def _command() -> list[str]:
        preferred, build, bundle = set_up_options()
        return install_command(sys.executable, preferred, build, bundle, online=bpy.app.online_access)


CLASSES = [HERITAGE_OT_set_up_engine]
