"""Correct an isolated object by clicks, or keep another of its levels in the project."""

from __future__ import annotations

import bpy

from ..engine.errors import ObjectError
from ..gaussian_heritage_addon.prompts import refine_arguments
from ..gaussian_heritage_addon.properties import HeritageClick, active_object
from .segmenting import Segmenting, clicks_of

__all__ = ["CLASSES"]


class HERITAGE_OT_refine_object(Segmenting, bpy.types.Operator):
    """Correct an object by clicks, or keep its level in the project; name, placement and record stay"""

    bl_idname = "heritage.refine_object"
    bl_label = "Refine Object"
    bl_options = {"REGISTER", "UNDO"}

    object_id: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Object", description="Its id in the project; empty: the one chosen in the panel", options={"SKIP_SAVE"}
    )
    clicks: bpy.props.CollectionProperty(  # type: ignore[valid-type]
        type=HeritageClick, name="Clicks", options={"SKIP_SAVE"}
    )
    level: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Level", description="0 is the smallest part; -1: as it is", default=-1, min=-1, options={"SKIP_SAVE"}
    )

    def what(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments for what was asked."""
        chosen, object_id = active_object(context.scene), self.object_id
        if not object_id:
            if chosen is None:
                raise ObjectError("Choose an isolated object in the list first.")
            object_id = chosen.heritage.object_id
        clicks = clicks_of(self)
        # Without clicks the engine only polishes the level, and loads no model.
        self.loads_sam = bool(clicks)
        return refine_arguments(object_id, clicks, self.level if self.level >= 0 else None)


CLASSES = [HERITAGE_OT_refine_object]
