"""Isolate every object of the scene without a prompt."""

from __future__ import annotations

import bpy

from .segmenting import SegmentOperator, replaced_background


class HERITAGE_OT_find_objects(SegmentOperator):
    """Isolate every object of the scene, with suggested names, and the background. Existing objects are kept"""

    bl_idname = "heritage.find_objects"
    bl_label = "Find All"

    def replaces(self, context: bpy.types.Context) -> str:
        """Name the background."""
        return replaced_background(context.scene)

    def segment_arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments."""
        return ["--all"]


CLASSES = [HERITAGE_OT_find_objects]
