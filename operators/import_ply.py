"""File > Import > Gaussian Scene (.ply, .spz, .sog, ...)."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..engine.formats import READ_SUFFIXES, Up
from ..gaussian_heritage_addon.blender.typed_properties import blender_properties
from ..gaussian_heritage_addon.project.new_objects import show_imported
from ..gaussian_heritage_addon.project.scene_file import add_other_file
from ..gaussian_heritage_addon.splats.render_settings import is_untouched, set_up_render
from .dropped_files import DroppedIntoView

_DIALOG_WIDTH = 450
_NOT_DROPPED = (".glb", ".json")
"""Blender itself takes a dropped GLB, and most JSON files have no Gaussians."""


@blender_properties
class HERITAGE_OT_import_gaussian_ply(bpy.types.Operator, ImportHelper):
    """Import a Gaussian scene from a file of any splatting program"""

    bl_idname = "heritage.import_gaussian_ply"
    bl_label = "Import Gaussian Scene"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ".ply"
    filter_glob: str = StringProperty(default=";".join(f"*{suffix}" for suffix in READ_SUFFIXES), options={"HIDDEN"})
    up: str = EnumProperty(
        name="Up Axis",
        description="Axis of the file that points up; GLB defines it",
        items=[
            (
                "AUTO",
                "As Stated",
                "What the file states; otherwise Y for SPZ, and -Y as in the files of most programs",
            ),
            ("z", "Z", "Z points up, as in Blender"),
            ("-y", "-Y", "Y points down, as in most Gaussian scenes"),
            ("y", "Y", "Y points up"),
        ],
    )
    skip_broken: bool = BoolProperty(
        name="Skip Broken",
        description="Skip Gaussians of a PLY with invalid values instead of rejecting the file",
    )
    use_cycles: bool = BoolProperty(
        name="Set up Cycles",
        description="In a new file, set the render engine to Cycles, with the settings that splats need",
        default=True,
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Open the file browser to select the file; for a dropped file, ask for the options only."""
        # What the operator was given the last time is a ghost.
        if self.properties.is_property_set("filepath", ghost=False):
            answer: set[str] = context.window_manager.invoke_props_dialog(self, width=_DIALOG_WIDTH)
            return answer
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import the file."""
        file = Path(bpy.path.abspath(self.filepath))
        up = None if self.up == "AUTO" else cast(Up, self.up)
        untouched = is_untouched(context.scene)
        notes: list[str] = []
        name = file.parent.name if file.name == "meta.json" and file.parent.name else file.stem
        splats = add_other_file(context.scene, file, name, up=up, skip_broken=self.skip_broken, tell=notes.append)
        if untouched and self.use_cycles:
            set_up_render(context.scene)
        show_imported(context.scene, splats.object)
        count = len(splats.object.data.vertices)
        self.report({"INFO"}, " ".join([f"Imported {count} Gaussians from {file.name}.", *notes]))
        return {"FINISHED"}


class HERITAGE_FH_gaussian_ply(DroppedIntoView, bpy.types.FileHandler):
    """Imports a file of Gaussians that is dropped into the viewport."""

    bl_idname = "HERITAGE_FH_gaussian_ply"
    bl_label = "Gaussian Scene"
    bl_import_operator = "heritage.import_gaussian_ply"
    bl_file_extensions = ";".join(suffix for suffix in READ_SUFFIXES if suffix not in _NOT_DROPPED)


CLASSES = [HERITAGE_OT_import_gaussian_ply, HERITAGE_FH_gaussian_ply]
