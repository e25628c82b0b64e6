"""Correct an isolated object by clicks, or store another of its levels in the project."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
from bpy.props import CollectionProperty, IntProperty, StringProperty

from ..engine.workers.jobs import refine_arguments
from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.splats.properties import HeritageClick
from ..gaussian_heritage_addon.splats.selection import active_object, heritage_objects
from .project_operator import listed_object, require_stored
from .segmenting import SegmentOperator, clicks_of


@call_properties
class HERITAGE_OT_refine_object(SegmentOperator):
    """Correct an object by clicks, or store its level in the project. Name, placement and record are kept"""

    bl_idname = "heritage.refine_object"
    bl_label = "Refine Object"

    object_id: str = StringProperty(
        name="Object", description="Id of the object in the project; empty: the object selected in the list"
    )
    clicks: Sequence[HeritageClick] = CollectionProperty(type=HeritageClick, name="Clicks")
    level: int = IntProperty(
        name="Level", description="0 is the smallest part; -1: do not change the level", default=-1, min=-1
    )

    def replaces(self, context: bpy.types.Context) -> str:
        """Name the object whose level is stored."""
        obj = active_object(context.scene)
        if self.clicks or self.object_id or obj is None:
            return ""
        return f"{obj.name} is stored at this level. Its present state goes to the project's trash."

    def segment_arguments(self, context: bpy.types.Context) -> list[str]:
        """Return the engine's arguments for the clicks or the level."""
        active, object_id = active_object(context.scene), self.object_id
        objects = heritage_objects(context.scene, "OBJECT")
        require_stored(obj for obj in objects if obj == active or obj.heritage.object_id == object_id)
        object_id = object_id or listed_object(context.scene).heritage.object_id
        clicks = clicks_of(self)
        # Without clicks, the engine only adds detail to the object at its level and loads no model.
        self.loads_sam = bool(clicks)
        return refine_arguments(object_id, clicks, self.level if self.level >= 0 else None)


CLASSES = [HERITAGE_OT_refine_object]
