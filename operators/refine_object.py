"""Correct an isolated object by clicks, or store another of its levels in the project."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import bpy
from bpy.props import CollectionProperty, IntProperty, StringProperty

from ..engine.core.errors import ObjectError
from ..engine.workers.jobs import refine_arguments
from ..gaussian_heritage_addon.blender.typed_properties import blender_properties
from ..gaussian_heritage_addon.project.hand_edits import edited_objects
from ..gaussian_heritage_addon.splats.properties import HeritageClick, active_object
from .segmenting import SegmentOperator, clicks_of

__all__ = ["CLASSES"]


@blender_properties
class HERITAGE_OT_refine_object(SegmentOperator):
    """Correct an object by clicks, or store its level in the project. Name, placement and record are kept"""

    bl_idname = "heritage.refine_object"
    bl_label = "Refine Object"

    object_id: Annotated[
        str,
        StringProperty(
            name="Object",
            description="Id of the object in the project; empty: the object selected in the list",
            options={"SKIP_SAVE"},
        ),
    ]
    clicks: Annotated[
        Sequence[HeritageClick], CollectionProperty(type=HeritageClick, name="Clicks", options={"SKIP_SAVE"})
    ]
    level: Annotated[
        int,
        IntProperty(
            name="Level",
            description="0 is the smallest part; -1: do not change the level",
            default=-1,
            min=-1,
            options={"SKIP_SAVE"},
        ),
    ]

    def replaces(self, context: bpy.types.Context) -> str:
        """Name the object whose level is stored."""
        obj = active_object(context.scene)
        if self.clicks or self.object_id or obj is None:
            return ""
        return f"{obj.name} is stored at this level. Its present state goes to the project's trash."

    def segment_arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments for the clicks or the level."""
        object_id = self.object_id
        for edited in edited_objects(context.scene):
            if edited.heritage.object_id == object_id or edited == active_object(context.scene):
                raise ObjectError(f"{edited.name} was edited by hand. Store its edits first, or undo them.")
        if not object_id:
            obj = active_object(context.scene)
            if obj is None:
                raise ObjectError("Select an isolated object in the list first.")
            object_id = obj.heritage.object_id
        clicks = clicks_of(self)
        # Without clicks, the engine only adds detail to the object at its level and loads no model.
        self.loads_sam = bool(clicks)
        return refine_arguments(object_id, clicks, self.level if self.level >= 0 else None)


CLASSES = [HERITAGE_OT_refine_object]
