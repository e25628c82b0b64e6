"""Preferences > Check: does the engine's Python have what it needs?"""

from __future__ import annotations

import bpy

from ..engine.errors import EnvironmentProblem, HeritageError
from ..gaussian_heritage_addon.engine_check import check_engine
from ..gaussian_heritage_addon.preferences import remember_check

__all__ = ["CLASSES"]


class HERITAGE_OT_check_engine(bpy.types.Operator):
    """Start the engine's Python and ask what it has and lacks"""

    bl_idname = "heritage.check_engine"
    bl_label = "Check"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Ask the engine."""
        try:
            python, lines, missing = check_engine()
            remember_check("\n".join(lines))
            if missing:
                raise EnvironmentProblem(f"{python} lacks {', '.join(missing)}. Install them there, then check again.")
        except HeritageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"{python} has all the engine needs.")
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_check_engine]
