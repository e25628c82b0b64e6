"""What the panels of the sidebar have in common."""

from __future__ import annotations

import bpy

from ..project.first_view import CATEGORY


class SidebarPanel(bpy.types.Panel):
    """A panel in the add-on's tab of the 3D viewports."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = CATEGORY


class ProjectPanel(SidebarPanel):
    """A panel that is shown while a project is open."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether a project is open."""
        return bool(context.scene.heritage.project)
