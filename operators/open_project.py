"""File > Import > Gaussian Heritage Project: a project folder that an earlier run made."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..engine.errors import HeritageError
from ..gaussian_heritage_addon.scene_file import open_project

__all__ = ["CLASSES"]


class HERITAGE_OT_open_project(bpy.types.Operator):
    """Bring a project folder into this file: its scene, cameras and objects"""

    bl_idname = "heritage.open_project"
    bl_label = "Open Project"
    bl_options = {"REGISTER", "UNDO"}

    directory: bpy.props.StringProperty(name="Project", subtype="DIR_PATH")  # type: ignore[valid-type]
    with_cameras: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Cameras", description="Add a camera for each photo", default=True
    )
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import the project."""
        try:
            open_project(context.scene, Path(bpy.path.abspath(self.directory)), with_cameras=self.with_cameras)
        except HeritageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_open_project]
