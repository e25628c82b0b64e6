"""File > Export > Gaussian Objects: one file per object, with its catalogue record."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ..gaussian_heritage_addon.export import export_splats
from ..gaussian_heritage_addon.properties import heritage_objects
from ..gaussian_heritage_addon.splats import SplatScene
from ..gaussian_heritage_addon.typed_properties import blender_properties

__all__ = ["CLASSES"]


@blender_properties
class HERITAGE_OT_export_objects(bpy.types.Operator):
    """Export each object to its own file, with its placement, scale and threshold in this scene"""

    bl_idname = "heritage.export_objects"
    bl_label = "Export Gaussian Objects"

    directory: Annotated[
        str, StringProperty(name="Folder", description="Folder for the exported files", subtype="DIR_PATH")
    ]
    format: Annotated[
        str,
        EnumProperty(
            name="Format",
            items=[
                ("PLY", "PLY", "Standard file of 3D Gaussian splatting"),
                ("GLB", "glTF", "Binary glTF with KHR_gaussian_splatting, Y up"),
            ],
        ),
    ]
    scope: Annotated[
        str,
        EnumProperty(
            name="Objects",
            items=[
                ("ALL", "All", "All isolated objects"),
                ("SELECTED", "Selected", "Selected splats, including whole scenes"),
                ("SCENE", "Scene", "The whole scene"),
            ],
        ),
    ]
    overwrite: Annotated[bool, BoolProperty(name="Replace Files", description="Replace existing files")]
    filter_folder: Annotated[bool, BoolProperty(default=True, options={"HIDDEN"})]

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Open the file browser to select the folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the files."""
        files = export_splats(
            self._objects(context),
            Path(bpy.path.abspath(self.directory)),
            self.format.lower(),
            overwrite=self.overwrite,
        )
        self.report({"INFO"}, f"Wrote {', '.join(file.name for file in files)}.")
        return {"FINISHED"}

    def _objects(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        if self.scope == "SELECTED":
            return [obj for obj in context.scene.objects if obj.select_get() and SplatScene.is_splats(obj)]
        return heritage_objects(context.scene, {"ALL": "OBJECT", "SCENE": "SCENE"}[self.scope])


CLASSES = [HERITAGE_OT_export_objects]
