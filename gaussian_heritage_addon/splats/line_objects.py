"""Objects that Blender draws as lines, such as cameras and rulers, and which of them may be drawn at a place of a view.

What Blender draws there can only be asked for by its own selection. The first time it compiles shaders, which holds up
a click, so it is asked only about lines that may be near.
"""

from __future__ import annotations

import itertools

import bpy
import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float64
from ..blender.world_placement import world_matrix
from .sight import Sight

_LINES = frozenset(("ARMATURE", "CAMERA", "EMPTY", "LATTICE", "LIGHT", "LIGHT_PROBE", "SPEAKER"))
"""Types of objects that Blender draws as lines."""
_MARGIN = 1.5
"""Size of the box around a camera or an empty, as a multiple of the size in which it is displayed."""
_FURTHER_LINES = ("show_limits", "show_mist", "show_sensor", "show_safe_areas", "show_safe_center")
"""Settings of a camera with which Blender draws more than its frame. There are also several guides."""
_GUIDES = "show_composition_"
_BOX: Float64 = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def lines_near(
    context: bpy.types.Context, sight: Sight, place: tuple[float, float], reach: float
) -> list[bpy.types.Object]:
    """Return the visible objects whose lines may be drawn within a distance of a place of the 3D view.

    Some that are farther away may be among them, but no ruler or other mesh of edges.

    Parameters
    ----------
    context : Context
        Of a 3D view.
    sight : Sight
        What its region shows.
    place : (float, float)
        In pixels from the lower left corner of the region.
    reach : float
        The distance in pixels.
    """
    found = []
    for obj in filter(_is_line, context.visible_objects):
        shapes = _shapes(context, obj)
        if shapes is None or sight.may_show(shapes, place, reach).any():
            found.append(obj)
    return found


def _is_line(obj: bpy.types.Object) -> bool:
    if obj.heritage.role != "NONE" or obj.hide_select:
        return False
    return obj.type in _LINES or (obj.type == "MESH" and len(obj.data.edges) > 0 and not len(obj.data.polygons))


def _shapes(context: bpy.types.Context, obj: bpy.types.Object) -> Float64 | None:
    """Return lines [S, 2, 3] in the world, or boxes [1, 8, 3] that hold all lines of an object; None where unknown."""
    if obj.show_axis or obj.show_bounds or obj.instance_type != "NONE":
        return None
    if obj.type == "MESH":
        own = _edges(obj.evaluated_get(context.evaluated_depsgraph_get()).data)
    elif obj.type == "EMPTY" and (obj.field is None or obj.field.type == "NONE"):
        offset = max(map(abs, obj.empty_image_offset)) if obj.empty_display_type == "IMAGE" else 0.0
        own = _MARGIN * (1.0 + offset) * obj.empty_display_size * _BOX[None]
    elif obj.type == "CAMERA" and not _has_further_lines(obj.data):
        frame = np.array(obj.data.view_frame(scene=context.scene), np.float64)
        own = _frame_lines(frame) if _looks_through(context, obj) else _frame_box(obj, frame)
    else:
        return None
    matrix = world_matrix(obj)
    placed: Float64 = own @ matrix[:3, :3].T + matrix[:3, 3]
    return placed


def _edges(mesh: bpy.types.Mesh) -> Float64:
    points = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", points.ravel())
    ends: NDArray[np.int32] = np.empty((len(mesh.edges), 2), np.int32)
    mesh.edges.foreach_get("vertices", ends.ravel())
    lines: Float64 = points.astype(np.float64)[ends]
    return lines


def _frame_lines(frame: Float64) -> Float64:
    """Return the four sides of the frame of the camera that the view looks through, which is all that is drawn."""
    return np.stack([frame, np.roll(frame, -1, axis=0)], axis=1)


def _frame_box(obj: bpy.types.Object, frame: Float64) -> Float64:
    """Return a box around the lines from a camera to its frame, and the triangle above."""
    # Blender draws it without the scale of the object.
    scales = np.linalg.norm(world_matrix(obj)[:3, :3], axis=0)
    size = obj.data.display_size
    # With perspective, Blender tells the frame of a camera of the size 1; otherwise that which is drawn, at a distance.
    factors = size if obj.data.type == "PERSP" else np.array([1.0, 1.0, max(1.0, size)])
    half = factors * np.abs(frame).max(axis=0) + (0.0, size, 0.0)
    box: Float64 = _MARGIN / min(1.0, max(1e-6, scales.min())) * half * _BOX[None]
    return box


def _has_further_lines(camera: bpy.types.Camera) -> bool:
    names = [one.identifier for one in camera.bl_rna.properties if one.identifier.startswith(_GUIDES)]
    return any(getattr(camera, name) for name in (*_FURTHER_LINES, *names))


def _looks_through(context: bpy.types.Context, obj: bpy.types.Object) -> bool:
    view, space = context.region_data, context.space_data
    if view is None or view.view_perspective != "CAMERA":
        return False
    camera = space.camera if space is not None and space.use_local_camera else context.scene.camera
    return bool(camera == obj)
