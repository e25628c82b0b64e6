"""Close the list of prompts that were not found."""

from __future__ import annotations

import bpy

from ..engine.project.refused_prompts import dismiss
from ..gaussian_heritage_addon.splats.properties import project_of


class HERITAGE_OT_dismiss_candidates(bpy.types.Operator):
    """Close the list of prompts that were not found"""

    bl_idname = "heritage.dismiss_candidates"
    bl_label = "Close List"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Delete the list."""
        dismiss(project_of(context.scene.heritage))
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_dismiss_candidates]
