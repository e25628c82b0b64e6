"""Find every object of the scene without a prompt."""

from __future__ import annotations

import bpy

from .segmenting import Segmenting

__all__ = ["CLASSES"]


class HERITAGE_OT_find_objects(Segmenting, bpy.types.Operator):
    """Isolate every object of the scene, with a suggested name each, and the background; those there already stay"""

    bl_idname = "heritage.find_objects"
    bl_label = "Find All"
    bl_options = {"REGISTER", "UNDO"}

    def what(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments."""
        return ["--all"]


CLASSES = [HERITAGE_OT_find_objects]
