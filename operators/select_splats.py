"""Select splat objects as all objects of Blender: by a click, a box or a lasso in Object Mode.

Blender has no shape of them to click, so its own tools find nothing there. These operators have the same keys. Where no
splats are meant, Blender's own tools get the event.
"""

from __future__ import annotations

import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty
from numpy.typing import NDArray

from ..engine.core.errors import ObjectError
from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.project.visible_splats import sight_of_viewport
from ..gaussian_heritage_addon.splats.view_selection import hides_splats, object_seen, objects_within, selectable_splats
from .path_drawing import PathOperator


@call_properties
class HERITAGE_OT_select_splats(bpy.types.Operator):
    """Select the splat object that is clicked"""

    bl_idname = "heritage.select_splats"
    bl_label = "Select Splats"
    bl_options = {"UNDO", "INTERNAL"}

    extend: bool = BoolProperty(name="Extend", description="Keep what is selected, and select this as well")
    deselect: bool = BoolProperty(name="Deselect", description="Take this out of what is selected")
    toggle: bool = BoolProperty(
        name="Toggle", description="Select this as well, or take it out where it is active already"
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Report an error: scripts select objects as all objects of Blender."""
        raise ObjectError(
            "Splats are selected in a 3D view of a window. In scripts, use select_set and objects.active."
        )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Select what is seen at the pointer, unless it belongs to another object of Blender."""
        splats = selectable_splats(context)
        if not splats:
            return {"PASS_THROUGH"}
        place = event.mouse_region_x, event.mouse_region_y
        sight = sight_of_viewport(context.region, context.region_data)
        obj, distance = object_seen(splats, sight.ray(place[0] + 0.5, place[1] + 0.5))
        if obj is None or hides_splats(context, sight, place, distance):
            return {"PASS_THROUGH"}
        if event.value != "PRESS":
            self.select(context, obj)
            return {"FINISHED"}
        # Where the user's keys select when the button is pressed, a drag then moves what is selected.
        self._obj, self._begin = obj.name, (event.mouse_x, event.mouse_y)
        self._button, self._waits = event.type, obj.select_get() and not (self.extend or self.deselect or self.toggle)
        if not self._waits:
            self.select(context, obj)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Wait until the button is released, or the mouse is dragged."""
        if event.type == self._button and event.value == "RELEASE":
            if self._waits and self._obj in context.view_layer.objects:
                self.select(context, context.view_layer.objects[self._obj])
            return {"FINISHED"}
        moved = max(abs(event.mouse_x - self._begin[0]), abs(event.mouse_y - self._begin[1]))
        if moved > context.preferences.inputs.drag_threshold_mouse:
            bpy.ops.transform.translate("INVOKE_DEFAULT", release_confirm=True)
            return {"FINISHED"}
        return {"RUNNING_MODAL"}

    def select(self, context: bpy.types.Context, obj: bpy.types.Object) -> None:
        """Select `obj` as Blender does."""
        objects = context.view_layer.objects
        if self.deselect or (self.toggle and obj.select_get() and objects.active == obj):
            obj.select_set(False)
            return
        if not self.extend and not self.toggle:
            for other in context.selected_objects:
                other.select_set(False)
        obj.select_set(True)
        objects.active = obj


@call_properties
class HERITAGE_OT_select_splats_within(PathOperator):
    """Select all objects, and splat objects, in a box or a lasso"""

    bl_idname = "heritage.select_splats_within"
    bl_label = "Select Splats Within"
    bl_options = {"UNDO", "INTERNAL"}

    mode: str = EnumProperty(
        name="Mode",
        description="What is done with the objects in the region",
        items=[
            ("SET", "Set", "Select them alone"),
            ("ADD", "Extend", "Select them as well"),
            ("SUB", "Subtract", "Take them out of what is selected"),
            ("XOR", "Difference", "Select those that were not selected, and the other way round"),
            ("AND", "Intersect", "Keep only those selected that were selected before"),
        ],
    )

    def tool_name(self) -> str:
        """Return the name of Blender's tool."""
        return "Select Box" if self.shape == "BOX" else "Select Lasso"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Report an error: scripts select objects as all objects of Blender."""
        raise ObjectError(
            "Splats are selected in a 3D view of a window. In scripts, use select_set and objects.active."
        )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Begin the region where a drag began, or wait for the mouse button."""
        if not selectable_splats(context):
            return {"PASS_THROUGH"}
        return self.begin_path(context, event)

    def drawn(
        self,
        context: bpy.types.Context,
        region: bpy.types.Region,
        view: bpy.types.RegionView3D,
        corners: NDArray[np.float64],
    ) -> set[str]:
        """Let Blender select its objects in the region, and select the splats in it."""
        if len(corners) < 3:
            return {"CANCELLED"}
        splats = selectable_splats(context)
        inside = objects_within(splats, sight_of_viewport(region, view), corners)
        before = {obj: obj.select_get() for obj in splats}
        self._select_others(corners)
        for obj in splats:
            obj.select_set(self.is_selected(before[obj], obj in inside))
        selected, objects = context.selected_objects, context.view_layer.objects
        # Blender leaves the active object as it is. Here it is always one of those that are selected.
        if objects.active not in selected and any(obj in selected for obj in inside):
            objects.active = next(obj for obj in inside if obj in selected)
        return {"FINISHED"}

    def is_selected(self, before: bool, inside: bool) -> bool:
        """Return whether an object is selected afterwards."""
        return {
            "SET": inside,
            "ADD": before or inside,
            "SUB": before and not inside,
            "XOR": before != inside,
            "AND": before and inside,
        }[self.mode]

    def _select_others(self, corners: NDArray[np.float64]) -> None:
        if self.shape == "BOX":
            (left, bottom), (right, top) = corners.min(axis=0).astype(int), corners.max(axis=0).astype(int)
            bpy.ops.view3d.select_box(
                xmin=int(left), xmax=int(right), ymin=int(bottom), ymax=int(top), wait_for_input=False, mode=self.mode
            )
            return
        path = [{"name": "", "loc": (float(x), float(y)), "time": 0.0} for x, y in corners]
        bpy.ops.view3d.select_lasso(path=path, mode=self.mode)


CLASSES = [HERITAGE_OT_select_splats, HERITAGE_OT_select_splats_within]
