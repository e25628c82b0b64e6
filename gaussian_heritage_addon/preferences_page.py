"""The add-on's page in the preferences: the engine's Python, and the model files with who may use them."""

from __future__ import annotations

import json

import bpy

from ..engine.masks.settings import SAM_MODELS
from . import job_runner
from .layouts import draw_job, say
from .model_files import Model, States, list_models
from .preferences import BASE_PACKAGE

__all__ = ["CLASSES"]

_ICONS = {"THERE": "CHECKMARK", "PROBLEM": "ERROR", "UNKNOWN": "QUESTION"}


class HeritagePreferences(bpy.types.AddonPreferences):
    """Which Python runs the engine, and which models it has."""

    bl_idname = BASE_PACKAGE

    engine_python: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Engine Python",
        description="Python of the engine's environment; empty: the one in GAUSSIAN_HERITAGE_PYTHON or .venv/engine",
        subtype="FILE_PATH",
    )
    check_result: bpy.props.StringProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]
    model_folder: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Offline Folder",
        description="Folder with model files a colleague downloaded; empty: they are fetched from the network",
        subtype="DIR_PATH",
    )
    sam: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Segment Anything",
        description="Which model cuts out what is clicked or named; all but the first must be fetched",
        items=[(name, name, "") for name in SAM_MODELS],
    )
    model_states: bpy.props.StringProperty(options={"SKIP_SAVE", "HIDDEN"})  # type: ignore[valid-type]

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the preferences."""
        layout = self.layout
        layout.prop(self, "engine_python")
        layout.operator("heritage.check_engine", icon="CHECKMARK")
        for line in self.check_result.splitlines():
            layout.label(text=line)
        layout.separator()
        row = layout.row()
        row.label(text="Models")
        row.operator("heritage.check_models", text="List").verify = False
        row.operator("heritage.check_models", text="Verify").verify = True
        running = job_runner.current()
        if running is not None and running[0].kind == "models" and not running[1].finished:
            # What a finished one found stands at each model below.
            draw_job(layout, *running)
        layout.prop(self, "sam")
        layout.prop(self, "model_folder")
        states: States = json.loads(self.model_states) if self.model_states else {}
        for model in list_models():
            _draw_model(layout.box(), model, states)


def _draw_model(box: bpy.types.UILayout, model: Model, states: States) -> None:
    state, problem = model.state(states)
    row = box.row()
    row.label(text=model.title, icon=_ICONS[state])
    if state != "THERE":
        row.operator("heritage.fetch_model", text="Fetch ...").name = model.name
    for line in model.terms:
        say(box, line)
    if problem:
        say(box, problem, icon="INFO")


CLASSES = [HeritagePreferences]
