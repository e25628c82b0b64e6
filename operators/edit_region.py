"""Add to an isolated object, or take from it, what lies in a lasso or a box that is drawn in the 3D view."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from bpy.props import CollectionProperty, EnumProperty
from numpy.typing import NDArray

from ..engine.core.errors import PromptError
from ..engine.formats import transform_gaussians
from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.blender.world_placement import world_matrix
from ..gaussian_heritage_addon.project.hand_edits import add_rows, take_vertices, whole_of
from ..gaussian_heritage_addon.project.visible_splats import sight_of_photo, sight_of_viewport
from ..gaussian_heritage_addon.splats.properties import HeritageClick, scene_count
from ..gaussian_heritage_addon.splats.region_selection import View, in_region
from ..gaussian_heritage_addon.splats.splats import SplatScene
from .path_drawing import PathOperator
from .project_operator import ProjectOperator, listed_object

_NAMES = {
    ("ADD", "LASSO"): "Add by Lasso",
    ("ADD", "BOX"): "Add by Box",
    ("TAKE", "LASSO"): "Take by Lasso",
    ("TAKE", "BOX"): "Take by Box",
}
"""Labels of the buttons, by action and shape."""


@call_properties
class HERITAGE_OT_edit_region(ProjectOperator, PathOperator):
    """Drag around what you mean. Add: it becomes part of the object selected in the list. Take: it leaves the object"""

    bl_idname = "heritage.edit_region"
    bl_label = "Edit in Region"
    bl_options = {"REGISTER", "UNDO"}

    action: str = EnumProperty(
        name="Action",
        description="What is done with the Gaussians in the region",
        items=[
            ("ADD", "Add", "Add what the region shows of the scene to the object"),
            ("TAKE", "Take", "Take what the region shows of the object away from it"),
        ],
    )
    depth: str = EnumProperty(
        name="Depth",
        description="How far behind the visible surface the region reaches",
        items=[
            ("AUTO", "Automatic", "The surface when something is added, everything when something is taken"),
            ("SURFACE", "Surface", "Only the surface that is seen"),
            ("THROUGH", "Through", "Also all that is behind it"),
        ],
    )
    path: Sequence[HeritageClick] = CollectionProperty(
        type=HeritageClick,
        name="Path",
        description="For scripts: the corners of the region in pixels of one photo; two corners are those of a box",
    )

    def tool_name(self) -> str:
        """Return the label of its button."""
        return _NAMES[self.action, self.shape]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Take the region from the arguments."""
        photos = {corner.photo for corner in self.path}
        if len(photos) != 1:
            raise PromptError(
                "Give the corners of the region as pixels of one photo. In a window, draw in the 3D view."
            )
        corners = np.array([(corner.x, corner.y) for corner in self.path], np.float64)
        return self._edit(context, sight_of_photo(context.scene, photos.pop()), corners)

    def drawn(self, context: bpy.types.Context, region: Any, view: Any, corners: NDArray[np.float64]) -> set[str]:
        """Take the region from the path that was drawn."""
        return self._edit(context, sight_of_viewport(region, view), corners)

    def _edit(self, context: bpy.types.Context, view: View, corners: NDArray[np.float64]) -> set[str]:
        obj = listed_object(context.scene)
        if len(corners) == 2:
            (left, top), (right, bottom) = corners
            corners = np.array([(left, top), (right, top), (right, bottom), (left, bottom)], np.float64)
        adds = self.action == "ADD"
        through = self.depth == "THROUGH" or (self.depth == "AUTO" and not adds)
        if adds:
            whole = whole_of(obj, context.scene)
            chosen = in_region(view, _world(whole, None), corners, through=through)
            count = add_rows(obj, SplatScene.of(whole).index(scene_count(whole))[chosen], whole)
        else:
            shown = np.flatnonzero(SplatScene.of(obj).shown)
            chosen = in_region(view, _world(obj, shown), corners, through=through)
            count = take_vertices(obj, shown[chosen]) if chosen.any() else 0
        if not count:
            self.report({"INFO"}, f"The region holds nothing that {obj.name} {'lacks' if adds else 'has'}.")
            return {"CANCELLED"}
        self.report({"INFO"}, f"{count:,} Gaussians were {'added to' if adds else 'taken from'} {obj.name}.")
        return {"FINISHED"}


def _world(obj: bpy.types.Object, vertices: NDArray[np.intp] | None) -> Any:
    gaussians = SplatScene.of(obj).local_gaussians()
    gaussians = gaussians if vertices is None else gaussians[vertices]
    return transform_gaussians(gaussians, world_matrix(obj))


CLASSES = [HERITAGE_OT_edit_region]
