"""Preferences > List, Verify: which model files are there, and are they what they should be?"""

from __future__ import annotations

import bpy

from ..engine.errors import HeritageError, ModelFileError
from ..gaussian_heritage_addon import job_runner

__all__ = ["CLASSES"]


class HERITAGE_OT_check_models(bpy.types.Operator):
    """Look which model files are there, and whether they are unchanged"""

    bl_idname = "heritage.check_models"
    bl_label = "Check Models"

    verify: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Verify",
        description="Only the files that are needed or there, and complain about each that is wrong",
        options={"SKIP_SAVE"},
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Ask the engine."""
        try:
            state = job_runner.start("models", job_runner.MODELS, "models", "verify" if self.verify else "list")
            if state is not None and self.verify and state.outputs.get("problems"):
                said = state.outputs["models"]
                raise ModelFileError(" ".join(said[name] for name in state.outputs["problems"]))
        except HeritageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_check_models]
