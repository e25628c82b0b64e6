"""File > Import > Gaussian Heritage Project: open the project folder of an earlier import."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import bpy
from bpy.props import BoolProperty, StringProperty

from ..gaussian_heritage_addon.scene_file import open_project
from ..gaussian_heritage_addon.typed_properties import blender_properties

__all__ = ["CLASSES"]


@blender_properties
class HERITAGE_OT_open_project(bpy.types.Operator):
    """Add a project folder to this file: its scene, cameras and objects"""

    bl_idname = "heritage.open_project"
    bl_label = "Open Project"
    bl_options = {"REGISTER", "UNDO"}

    directory: Annotated[str, StringProperty(name="Project", subtype="DIR_PATH")]
    with_cameras: Annotated[bool, BoolProperty(name="Cameras", description="Add a camera for each photo", default=True)]
    filter_folder: Annotated[bool, BoolProperty(default=True, options={"HIDDEN"})]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Open the file browser to select the folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import the project."""
        open_project(context.scene, Path(bpy.path.abspath(self.directory)), with_cameras=self.with_cameras)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_open_project]
