"""Preferences > Check: check that the engine's Python has everything the engine needs."""

from __future__ import annotations

import bpy

from ..engine.errors import EnvironmentProblem
from ..gaussian_heritage_addon.engine_check import check_engine
from ..gaussian_heritage_addon.preferences import store_check_result

__all__ = ["CLASSES"]


class HERITAGE_OT_check_engine(bpy.types.Operator):
    """Check that the engine's Python has everything the engine needs"""

    bl_idname = "heritage.check_engine"
    bl_label = "Check"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run the check."""
        python, lines, missing = check_engine()
        store_check_result("\n".join(lines))
        if missing:
            raise EnvironmentProblem(f"{python} lacks {', '.join(missing)}. Install them there, then check again.")
        self.report({"INFO"}, f"{python} has everything the engine needs.")
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_check_engine]
