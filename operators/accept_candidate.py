"""Isolate a candidate for a prompt that was not found."""

from __future__ import annotations

import bpy
from bpy.props import IntProperty, StringProperty

from ..engine.workers.jobs import name_arguments
from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from .segmenting import SegmentOperator


@call_properties
class HERITAGE_OT_accept_candidate(SegmentOperator):
    """Isolate this candidate and name it after the prompt"""

    bl_idname = "heritage.accept_candidate"
    bl_label = "Isolate Candidate"

    number: int = IntProperty(name="Number", description="Number of the candidate", min=1)
    name: str = StringProperty(name="Name", description="Name of the object; empty: the prompt")

    def segment_arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments."""
        return [f"--accept={self.number}", *name_arguments(self.name.strip())]


CLASSES = [HERITAGE_OT_accept_candidate]
