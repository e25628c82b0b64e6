"""The panels *By Hand*, with the edits of objects, and *Measure*, with scale, ground and rulers."""

from __future__ import annotations

import bpy

from ...engine.core.errors import HeritageError
from ...engine.scene import Measurement
from ..blender.drawn_text import draw_text
from ..blender.lengths import write_length
from ..language.translations import translated
from ..project.measuring import current_measurement, length_text, rulers
from ..splats.properties import HeritageScene, project_of
from ..splats.selection import active_object
from .sidebar import ProjectPanel


class HERITAGE_PT_by_hand(ProjectPanel):
    """Edits of the object that is selected in the list."""

    bl_label = "By Hand"
    bl_idname = "HERITAGE_PT_by_hand"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout, scene = self.layout, context.scene
        row = layout.row(align=True)
        row.operator("heritage.pick_object", text="Select in View", icon="RESTRICT_SELECT_OFF").action = "SELECT"
        row.operator("heritage.pick_object", text="Isolate in View", icon="EYEDROPPER").action = "ISOLATE"
        obj = active_object(scene)
        if obj is not None:
            box = layout.column(align=True)
            box.label(text=obj.name, icon="OUTLINER_OB_POINTCLOUD")
            _draw_regions(box)
            row = box.row(align=True)
            row.operator("heritage.floaters", text="Show Floaters", icon="HIDE_OFF").remove = False
            row.operator("heritage.floaters", text="Remove Floaters").remove = True
            row = box.row(align=True)
            row.operator("heritage.merge_objects", text="Merge Selected", icon="AUTOMERGE_ON").names = ""
            row.operator("heritage.delete_object", text="Delete", icon="TRASH")
        if context.mode == "EDIT_MESH":
            column = layout.column(align=True)
            column.operator("heritage.assign_to_object", icon="FORWARD")
            column.operator("heritage.take_selection", icon="REMOVE")
            column.operator("heritage.split_object", text="Split Off as New Object", icon="MOD_EXPLODE").name = ""


def _draw_regions(layout: bpy.types.UILayout) -> None:
    row = layout.row(align=True)
    lasso = row.operator("heritage.edit_region", text="Add by Lasso", icon="ADD")
    box = row.operator("heritage.edit_region", text="Add by Box", icon="ADD")
    (lasso.action, lasso.shape), (box.action, box.shape) = ("ADD", "LASSO"), ("ADD", "BOX")
    row = layout.row(align=True)
    lasso = row.operator("heritage.edit_region", text="Take by Lasso", icon="REMOVE")
    box = row.operator("heritage.edit_region", text="Take by Box", icon="REMOVE")
    (lasso.action, lasso.shape), (box.action, box.shape) = ("TAKE", "LASSO"), ("TAKE", "BOX")


class HERITAGE_PT_measure(ProjectPanel):
    """Scale, ground, north, origin and rulers."""

    bl_label = "Measure"
    bl_idname = "HERITAGE_PT_measure"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout, scene = self.layout, context.scene
        properties: HeritageScene = scene.heritage
        try:
            measurement = current_measurement(project_of(properties))
        except HeritageError as error:
            draw_text(layout, str(error), icon="ERROR")
            layout.operator("heritage.clear_measurement", icon="TRASH").distance = 0
            return
        _draw_scale(layout, properties, measurement)
        column = layout.column(align=True)
        done = {True: "CHECKMARK", False: "BLANK1"}
        ground = column.row(align=True)
        button = ground.operator("heritage.measure", text="Ground", icon=done[bool(measurement.ground)])
        button.action = "GROUND"
        ground.operator("heritage.ground_from_plane", text="From Plane")
        row = column.row(align=True)
        row.operator("heritage.measure", text="North", icon=done[measurement.north is not None]).action = "NORTH"
        row.operator("heritage.measure", text="Origin", icon=done[measurement.origin is not None]).action = "ORIGIN"
        layout.operator("heritage.measure", text="Ruler", icon="DRIVER_DISTANCE").action = "RULER"
        for _, length in rulers(scene):
            layout.label(text=length_text(scene, length), icon="ARROW_LEFTRIGHT")
        if not measurement.is_empty:
            layout.operator("heritage.clear_measurement", icon="TRASH").distance = 0


def _draw_scale(layout: bpy.types.UILayout, properties: HeritageScene, measurement: Measurement) -> None:
    if measurement.metres_per_unit is None:
        draw_text(layout, "The unit is unknown. Pick two points whose distance you know.", icon="INFO")
    layout.label(text="Known Distance")
    row = layout.row(align=True)
    row.prop(properties, "known_distance_text", text="")
    button = row.operator("heritage.measure", text="Pick", icon="EYEDROPPER")
    button.action, button.metres = "DISTANCE", properties.known_distance
    pairs = zip(measurement.distances, measurement.residuals, strict=True)
    for number, (distance, residual) in enumerate(pairs, 1):
        row = layout.row(align=True)
        off = f" ({residual * 1000:+.1f} mm)" if len(measurement.distances) > 1 else ""
        row.label(text=f"{write_length(distance.metres)}{off}")
        row.operator("heritage.clear_measurement", text="", icon="X").distance = number
    if measurement.scale_residual is not None:
        layout.label(text=translated("They agree within {:.1f} mm", measurement.scale_residual * 1000))


CLASSES = [HERITAGE_PT_by_hand, HERITAGE_PT_measure]
