"""Close the list of prompts that were not found."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..engine.errors import HeritageError
from ..gaussian_heritage_addon.candidates import dismiss

__all__ = ["CLASSES"]


class HERITAGE_OT_dismiss_candidates(bpy.types.Operator):
    """Close the list of prompts that were not found"""

    bl_idname = "heritage.dismiss_candidates"
    bl_label = "Close List"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Delete the list."""
        try:
            dismiss(Path(bpy.path.abspath(context.scene.heritage.project)))
        except HeritageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_dismiss_candidates]
