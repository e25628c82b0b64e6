"""Rulers over the splats of a 3D view, which would cover what Blender draws of them."""

from __future__ import annotations

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ...engine.core.arrays import Float64
from ..blender.guards import add_draw_handler, on_unregister, remove_draw_handler
from ..blender.world_placement import drawn_matrix
from ..splats.sight import Sight
from .measuring import rulers
from .visible_splats import sight_of_viewport

MARK_COLOR = (1.0, 0.75, 0.2, 1.0)
"""Of what is drawn over the splats of a view."""
_LINES = (((0.0, 0.0, 0.0, 1.0), 4.0), (MARK_COLOR, 2.0))
"""Colour, and width in pixels, of the lines that are drawn over each other: seen on light and dark splats."""
_TEXT_SIZE = 14
_TEXT_OFFSET = 6


def rulers_in_view(context: bpy.types.Context, sight: Sight) -> list[tuple[str, Float64]]:
    """Return the visible rulers that are before the eye: the name of each, and its ends [2, 2] in pixels."""
    known, found = rulers(context.scene), []
    # Asked only where there are rulers: this runs whenever a view is drawn.
    visible = set(context.visible_objects) if known else set()
    for ruler, _ in known:
        if ruler in visible:
            placement = drawn_matrix(ruler)
            ends = sight.positions(np.array([placement @ vertex.co for vertex in ruler.data.vertices], np.float64))
            if np.isfinite(ends).all():
                found.append((ruler.name, ends))
    return found


def _draw() -> None:
    context = bpy.context
    if not context.space_data.overlay.show_overlays or context.region_data is None:
        return
    shown = rulers_in_view(context, sight_of_viewport(context.region, context.region_data))
    if not shown:
        return
    shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
    batch = batch_for_shader(shader, "LINES", {"pos": [(x, y, 0.0) for _, ends in shown for x, y in ends.tolist()]})
    shader.uniform_float("viewportSize", (context.region.width, context.region.height))
    scale = context.preferences.system.ui_scale
    for color, width in _LINES:
        shader.uniform_float("lineWidth", width * scale)
        shader.uniform_float("color", color)
        batch.draw(shader)
    blf.size(0, _TEXT_SIZE * scale)
    blf.color(0, *MARK_COLOR)
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 5, *_LINES[0][0])
    for name, ends in shown:
        x, y = ends.mean(axis=0)
        # To the right of the middle, on the side from which the line turns away.
        rises = np.prod(ends[1] - ends[0]) > 0
        blf.position(0, x + _TEXT_OFFSET * scale, y - rises * (_TEXT_SIZE + _TEXT_OFFSET) * scale, 0)
        blf.draw(0, name)
    blf.disable(0, blf.SHADOW)


def register() -> None:
    """Draw the rulers from now on."""
    if not bpy.app.background:
        on_unregister(remove_draw_handler, bpy.types.SpaceView3D, add_draw_handler(bpy.types.SpaceView3D, _draw))
