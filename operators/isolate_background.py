"""Isolate what belongs to no object."""

from __future__ import annotations

import bpy

from .segmenting import Segmenting

__all__ = ["CLASSES"]


class HERITAGE_OT_isolate_background(Segmenting, bpy.types.Operator):
    """Isolate the background: what belongs to none of the objects; an earlier background is replaced"""

    bl_idname = "heritage.isolate_background"
    bl_label = "Background"
    bl_options = {"REGISTER", "UNDO"}
    loads_sam = False

    def what(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments."""
        return ["--complement"]


CLASSES = [HERITAGE_OT_isolate_background]
