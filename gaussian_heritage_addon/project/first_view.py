"""The view when a job starts and when a scene arrives: the sidebar, and the scene through a photo."""

from __future__ import annotations

import contextlib

import bpy

from ..blender.guards import Timer
from ..splats.properties import photo_of
from ..splats.solid_mode import OPAQUE_MODES, update_shapes, viewports
from .cameras import INITIAL_RENDER_SIDE, current_photo, look_through

CATEGORY = "Heritage"
"""Name of the add-on's tab in the sidebar."""
_DRAWN_AFTER = 0.3
"""Seconds until a sidebar that was opened is drawn: only then does Blender know its tabs."""


def show_job() -> None:
    """Open the sidebar of the 3D viewports at the add-on's tab, where the progress is shown."""
    if bpy.app.background:
        return
    for area in viewports():
        area.spaces.active.show_region_ui = True
    _tab_timer.start(_DRAWN_AFTER)


def _open_tab() -> None:
    for area in viewports():
        for region in area.regions:
            if region.type == "UI":
                # Read-only while the sidebar shows no tabs.
                with contextlib.suppress(AttributeError, TypeError):
                    region.active_panel_category = CATEGORY
                region.tag_redraw()


_tab_timer = Timer(_open_tab)


def show_scene(scene: bpy.types.Scene) -> None:
    """Let the 3D viewports of `scene` show it through a photo. Splats are drawn in every mode of shading.

    For the display *Shapes*, the mode Solid is prepared to show them in their colours.
    """
    if bpy.app.background:
        return
    if not current_photo(scene) and any(photo_of(obj) for obj in scene.objects):
        look_through(scene, "", INITIAL_RENDER_SIDE)
    for area in viewports(scene):
        space = area.spaces.active
        if space.shading.type in OPAQUE_MODES:
            space.shading.color_type, space.shading.light = "VERTEX", "FLAT"
            space.shading.show_object_outline = False
        space.clip_start = min(space.clip_start, 0.01)
        if current_photo(scene):
            space.region_3d.view_perspective = "CAMERA"
    update_shapes()
