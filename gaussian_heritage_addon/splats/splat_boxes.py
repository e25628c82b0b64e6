"""The box around what is shown of an object: drawn for selected and new objects, and framed for new ones."""

from __future__ import annotations

import time

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from ...engine.scene import box_of
from ..blender.guards import Timer
from ..blender.world_placement import drawn_matrix, world_matrix
from .selection import active_object
from .solid_mode import redraw_viewports
from .splats import SplatScene

Box = tuple[NDArray[np.float64], NDArray[np.float64]]
_FLASH_SECONDS, _BLINK_SECONDS = 3.0, 0.3
"""How long the box of a new object flashes, and how long it is on or off."""
_FLASH_COLOR = (1.0, 0.85, 0.2, 1.0)
_LINE_WIDTH = 1.5
_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)]
"""Pairs of corners, whose numbers have the bits x, y and z."""
_FRAME_DISTANCE = 3.0
"""Distance from which a box is framed, as a multiple of half its diagonal: it fills a half of the view."""
_flashing: dict[str, float] = {}
"""By name: when the box of an object stops flashing."""


def shown_box(obj: bpy.types.Object) -> Box | None:
    """Return the bounds of the Gaussians of `obj` that are shown, in its frame, without far single ones; None: none."""
    splats = SplatScene.of(obj)
    means = splats.attribute("position")[splats.shown]
    return box_of(means) if len(means) else None


def draw_boxes(context: bpy.types.Context, boxes: dict[str, Box | None]) -> None:
    """Draw the boxes, by the names of their objects, of those that are selected or flash."""
    theme, now = context.preferences.themes[0].view_3d, time.monotonic()
    chosen = active_object(context.scene)
    for name, box in boxes.items():
        obj = bpy.data.objects[name]
        ends = _flashing.get(name, 0.0)
        blinks = now < ends and int((ends - now) / _BLINK_SECONDS) % 2 == 0
        if box is None or not (blinks or obj == chosen or obj.select_get()):
            continue
        is_active = obj == context.view_layer.objects.active
        color = theme.object_active if is_active else theme.object_selected
        _draw_lines(drawn_matrix(obj), _corners(box), _FLASH_COLOR if blinks else (*color, 1.0))


def _corners(box: Box) -> list[Vector]:
    return [Vector([box[bit >> axis & 1][axis] for axis in range(3)]) for bit in range(8)]


def _draw_lines(placement: Matrix, corners: list[Vector], color: tuple[float, ...]) -> None:
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    batch = batch_for_shader(shader, "LINES", {"pos": [corners[end] for edge in _EDGES for end in edge]})
    _, _, width, height = gpu.state.viewport_get()
    with gpu.matrix.push_pop():
        gpu.matrix.multiply_matrix(placement)
        shader.bind()
        shader.uniform_float("viewportSize", (width, height))
        shader.uniform_float("lineWidth", _LINE_WIDTH)
        shader.uniform_float("color", color)
        batch.draw(shader)


def flash(objects: list[bpy.types.Object]) -> None:
    """Let the boxes of `objects` flash for some seconds."""
    ends = time.monotonic() + _FLASH_SECONDS
    _flashing.update((obj.name, ends) for obj in objects)
    _blink_timer.start(0.0)


def _blink() -> float | None:
    redraw_viewports()
    now = time.monotonic()
    for name in [name for name, ends in _flashing.items() if ends < now]:
        del _flashing[name]
    return _BLINK_SECONDS if _flashing else None


_blink_timer = Timer(_blink)


def frame(region: bpy.types.RegionView3D, objects: list[bpy.types.Object], camera: bpy.types.Object | None) -> None:
    """Turn a view to `objects`, from the side that it is seen from now."""
    corners = []
    for obj in objects:
        box = shown_box(obj)
        if box is not None:
            placement = Matrix(world_matrix(obj).tolist())
            corners += [placement @ corner for corner in _corners(box)]
    if not corners:
        return
    low = Vector(map(min, zip(*corners, strict=True)))
    high = Vector(map(max, zip(*corners, strict=True)))
    if region.view_perspective == "CAMERA" and camera is not None:
        region.view_rotation = Matrix(world_matrix(camera).tolist()).to_quaternion()
        region.view_perspective = "PERSP"
    region.view_location = (low + high) / 2
    region.view_distance = max(_FRAME_DISTANCE * (high - low).length / 2, 1e-3)
