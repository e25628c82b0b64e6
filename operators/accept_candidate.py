"""Isolate one of the candidates that came nearest to a text that was not found."""

from __future__ import annotations

import bpy

from .segmenting import Segmenting

__all__ = ["CLASSES"]


class HERITAGE_OT_accept_candidate(Segmenting, bpy.types.Operator):
    """Isolate this after all; it gets the name that was asked for"""

    bl_idname = "heritage.accept_candidate"
    bl_label = "Isolate Candidate"
    bl_options = {"REGISTER", "UNDO"}

    number: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Number", description="Of the candidate", min=1, options={"SKIP_SAVE"}
    )
    name: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Name", description="Of the object; empty: the prompt", options={"SKIP_SAVE"}
    )

    def what(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments."""
        name = self.name.strip()
        return ["--accept", str(self.number), *(["--name", name] if name else [])]


CLASSES = [HERITAGE_OT_accept_candidate]
