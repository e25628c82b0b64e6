"""Splats in the viewport modes Solid and Wireframe: opaque shapes in their colours instead of blended ellipsoids."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ..blender.guards import add_load_handler, subscribe
from .selection import heritage_objects
from .splat_nodes import SOLID, display_input, set_display_input

OPAQUE_MODES = ("SOLID", "WIREFRAME")
"""Types of shading that draw no transparency and no materials."""


def update_shapes() -> None:
    """Let the splats of each scene be drawn as the viewports that show it need them.

    The shapes belong to the object and not to a viewport: where one of several viewports shows materials, all get
    blended ellipsoids.
    """
    for scene in bpy.data.scenes:
        modes = [area.spaces.active.shading.type for area in viewports(scene)]
        if not modes:
            continue
        solid = all(mode in OPAQUE_MODES for mode in modes)
        for obj in heritage_objects(scene):
            if display_input(obj, SOLID) != solid:
                set_display_input(obj, SOLID, solid)


def viewports(scene: bpy.types.Scene | None = None) -> Iterator[bpy.types.Area]:
    """Yield the 3D viewports of all windows, or of those that show `scene`."""
    for window in bpy.context.window_manager.windows:
        if scene is None or window.scene == scene:
            yield from (area for area in window.screen.areas if area.type == "VIEW_3D")


def redraw_viewports() -> None:
    """Draw the scene of all 3D viewports again, without their sidebars."""
    for area in viewports():
        for region in area.regions:
            if region.type == "WINDOW":
                region.tag_redraw()


def _follow() -> None:
    """Follow the viewports' modes. Blender forgets subscriptions when it loads a file."""
    subscribe((bpy.types.View3DShading, "type"), update_shapes)
    update_shapes()


def register() -> None:
    """Follow the modes of the viewports, now and in each file that is loaded."""
    if not bpy.app.background:
        subscribe((bpy.types.View3DShading, "type"), update_shapes)
        add_load_handler(_follow)
