"""Isolate the background: everything that belongs to no object."""

from __future__ import annotations

import bpy

from .segmenting import SegmentOperator, replaced_background


class HERITAGE_OT_isolate_background(SegmentOperator):
    """Isolate what belongs to no object as the background. An earlier background goes to the project's trash"""

    bl_idname = "heritage.isolate_background"
    bl_label = "Background"
    loads_sam = False

    def replaces(self, context: bpy.types.Context) -> str:
        """Name the background."""
        return replaced_background(context.scene)

    def segment_arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments."""
        return ["--complement"]


CLASSES = [HERITAGE_OT_isolate_background]
