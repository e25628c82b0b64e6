"""File > Import > Gaussian Scene (.ply)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import bpy
from bpy.props import BoolProperty, StringProperty
from bpy_extras.io_utils import ImportHelper, poll_file_object_drop

from ..gaussian_heritage_addon.scene_file import add_splat_file, prepare_cycles
from ..gaussian_heritage_addon.typed_properties import blender_properties

__all__ = ["CLASSES"]


@blender_properties
class HERITAGE_OT_import_gaussian_ply(bpy.types.Operator, ImportHelper):
    """Import a Gaussian scene from a PLY file, as written by any Gaussian splatting program"""

    bl_idname = "heritage.import_gaussian_ply"
    bl_label = "Import Gaussian Scene"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ".ply"
    filter_glob: Annotated[str, StringProperty(default="*.ply", options={"HIDDEN"})]
    skip_broken: Annotated[
        bool,
        BoolProperty(
            name="Skip Broken",
            description="Skip Gaussians with invalid values instead of rejecting the file",
        ),
    ]
    use_cycles: Annotated[
        bool,
        BoolProperty(
            name="Set up Cycles",
            description="Set the render engine to Cycles, with the settings that splats need",
            default=True,
        ),
    ]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import the file."""
        file = Path(bpy.path.abspath(self.filepath))
        splats = add_splat_file(context.scene, file, file.stem, skip_broken=self.skip_broken)
        if self.use_cycles:
            prepare_cycles(context.scene)
        count = len(splats.object.data.vertices)
        self.report({"INFO"}, f"Imported {count} Gaussians from {file.name}.")
        return {"FINISHED"}


class HERITAGE_FH_gaussian_ply(bpy.types.FileHandler):
    """Imports a Gaussian PLY file that is dropped into the viewport."""

    bl_idname = "HERITAGE_FH_gaussian_ply"
    bl_label = "Gaussian Scene"
    bl_import_operator = "heritage.import_gaussian_ply"
    bl_file_extensions = ".ply"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """Return whether files can be dropped here: in the 3D viewport and the outliner."""
        return poll_file_object_drop(context)


CLASSES = [HERITAGE_OT_import_gaussian_ply, HERITAGE_FH_gaussian_ply]
