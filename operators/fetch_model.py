"""Preferences > Fetch: fetch the files of a model, after showing its licence and permitted users."""

from __future__ import annotations

import bpy
from bpy.props import StringProperty

from ..gaussian_heritage_addon.blender.drawn_text import draw_text
from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.jobs import job_runner
from ..gaussian_heritage_addon.setup.model_files import fetch_arguments, find_model
from ..gaussian_heritage_addon.setup.preferences import model_folder

_DIALOG_WIDTH, _DIALOG_LINE_LENGTH = 500, 75
"""Width of the dialog in pixels at the default interface scale, and the number of characters that fit a line."""


@call_properties
class HERITAGE_OT_fetch_model(bpy.types.Operator):
    """Fetch the files of a model. Its licence is shown first. Resumes a download that was stopped"""

    bl_idname = "heritage.fetch_model"
    bl_label = "Fetch Model"

    name: str = StringProperty(name="Model")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Show the licence and ask for confirmation."""
        return context.window_manager.invoke_props_dialog(self, width=_DIALOG_WIDTH, confirm_text="Fetch")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the dialog."""
        model = find_model(self.name)
        self.layout.label(text=model.title)
        for line in (*model.terms, *([model_folder()] if model_folder() else model.sources)):
            draw_text(self.layout, line, line_length=_DIALOG_LINE_LENGTH)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the engine."""
        arguments = fetch_arguments(self.name, model_folder(), online=bpy.app.online_access)
        state = job_runner.start("models", job_runner.MODEL_FILES, *arguments)
        message = "Fetching in the background; progress is shown here." if state is None else state.message
        self.report({"INFO"}, message)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_fetch_model]
