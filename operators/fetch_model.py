"""Preferences > Fetch: get a model's files, after its licence and who may use it have been shown."""

from __future__ import annotations

import bpy

from ..engine.errors import HeritageError
from ..gaussian_heritage_addon import job_runner
from ..gaussian_heritage_addon.layouts import say
from ..gaussian_heritage_addon.model_files import fetch_arguments, find_model
from ..gaussian_heritage_addon.preferences import model_folder

__all__ = ["CLASSES"]

_DIALOG_WIDTH, _DIALOG_LETTERS = 500, 75
"""Pixels at Blender's usual size, and what fits into them."""


class HERITAGE_OT_fetch_model(bpy.types.Operator):
    """Fetch a model's files; shows its licence first. A fetch that was stopped goes on where it was"""

    bl_idname = "heritage.fetch_model"
    bl_label = "Fetch Model"

    name: bpy.props.StringProperty(name="Model", options={"SKIP_SAVE"})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Show what it is and who may use it, and ask."""
        return context.window_manager.invoke_props_dialog(self, width=_DIALOG_WIDTH, confirm_text="Fetch")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the question."""
        model = find_model(self.name)
        self.layout.label(text=model.title)
        for line in (*model.terms, *([model_folder()] if model_folder() else model.sources)):
            say(self.layout, line, letters=_DIALOG_LETTERS)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the engine."""
        try:
            arguments = fetch_arguments(self.name, model_folder(), online=bpy.app.online_access)
            state = job_runner.start("models", job_runner.MODELS, *arguments)
        except HeritageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, "Fetching in the background; progress is shown here." if state is None else state.message)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_fetch_model]
