"""Preferences > List, Verify: list the model files, or verify that they are unchanged."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty

from ..engine.core.errors import ModelFileError
from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.jobs import job_runner
from ..gaussian_heritage_addon.setup.model_files import problems_of


@call_properties
class HERITAGE_OT_check_models(bpy.types.Operator):
    """Check which model files are available and whether they are unchanged"""

    bl_idname = "heritage.check_models"
    bl_label = "Check Models"

    verify: bool = BoolProperty(
        name="Verify", description="Check only required and available files, and report every problem"
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run the check."""
        command = "verify" if self.verify else "list"
        state = job_runner.start("models", job_runner.MODEL_FILES, "models", command)
        problems = problems_of(state.outputs) if state is not None and self.verify else []
        if problems:
            raise ModelFileError(" ".join(problems))
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_check_models]
