"""File > Import > Gaussian Scene (.ply)."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper, poll_file_object_drop

from ..engine.errors import HeritageError
from ..gaussian_heritage_addon.scene_file import add_splat_file, prepare_cycles

__all__ = ["CLASSES"]


class HERITAGE_OT_import_gaussian_ply(bpy.types.Operator, ImportHelper):
    """Import a Gaussian scene saved as PLY by any Gaussian splatting program"""

    bl_idname = "heritage.import_gaussian_ply"
    bl_label = "Import Gaussian Scene"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ".ply"
    filter_glob: bpy.props.StringProperty(default="*.ply", options={"HIDDEN"})  # type: ignore[valid-type]
    skip_broken: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Skip Broken",
        description="Leave out Gaussians with values that are not finite, instead of refusing the file",
    )
    use_cycles: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Set up Cycles", description="Make Cycles the render engine, with the settings splats need", default=True
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import the file."""
        file = Path(bpy.path.abspath(self.filepath))
        try:
            splats = add_splat_file(context.scene, file, file.stem, skip_broken=self.skip_broken)
        except HeritageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if self.use_cycles:
            prepare_cycles(context.scene)
        count = len(splats.object.data.vertices)
        self.report({"INFO"}, f"Imported {count} Gaussians from {file.name}.")
        return {"FINISHED"}


class HERITAGE_FH_gaussian_ply(bpy.types.FileHandler):
    """Lets a Gaussian PLY be dropped into the viewport."""

    bl_idname = "HERITAGE_FH_gaussian_ply"
    bl_label = "Gaussian Scene"
    bl_import_operator = "heritage.import_gaussian_ply"
    bl_file_extensions = ".ply"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """In the 3D viewport and the outliner."""
        return poll_file_object_drop(context)


CLASSES = [HERITAGE_OT_import_gaussian_ply, HERITAGE_FH_gaussian_ply]
