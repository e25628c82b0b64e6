"""File > Export > Gaussian Objects: one file for each object, with its record."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..engine.errors import HeritageError
from ..gaussian_heritage_addon.export import export_splats
from ..gaussian_heritage_addon.properties import heritage_objects
from ..gaussian_heritage_addon.splats import SplatScene

__all__ = ["CLASSES"]


class HERITAGE_OT_export_objects(bpy.types.Operator):
    """Write each object to a file of its own, as placed, scaled and thresholded in this scene"""

    bl_idname = "heritage.export_objects"
    bl_label = "Export Gaussian Objects"

    directory: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Folder", description="Where the files go", subtype="DIR_PATH"
    )
    format: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Format",
        items=[
            ("PLY", "PLY", "Standard 3D Gaussian splatting file"),
            ("GLB", "glTF", "glTF binary with KHR_gaussian_splatting, Y up"),
        ],
    )
    scope: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Objects",
        items=[
            ("ALL", "All", "Every isolated object"),
            ("SELECTED", "Selected", "Selected splats, whole scenes too"),
            ("SCENE", "Scene", "The whole scene"),
        ],
    )
    overwrite: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Replace Files", description="Replace files that are there already"
    )
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})  # type: ignore[valid-type]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the files."""
        try:
            files = export_splats(
                self._objects(context),
                Path(bpy.path.abspath(self.directory)),
                self.format.lower(),
                overwrite=self.overwrite,
            )
        except HeritageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"Wrote {', '.join(file.name for file in files)}.")
        return {"FINISHED"}

    def _objects(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        if self.scope == "SELECTED":
            return [obj for obj in context.scene.objects if obj.select_get() and SplatScene.is_splats(obj)]
        return heritage_objects(context.scene, {"ALL": "OBJECT", "SCENE": "SCENE"}[self.scope])


CLASSES = [HERITAGE_OT_export_objects]
