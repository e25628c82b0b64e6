"""File > Export > Gaussian Objects, one file per object with its catalogue record; and several splats as one file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..engine.errors import ObjectError
from ..gaussian_heritage_addon.export import (
    FORMATS,
    ExportOptions,
    can_be_exported,
    export_splats,
    export_together,
)
from ..gaussian_heritage_addon.properties import heritage_objects
from ..gaussian_heritage_addon.typed_properties import blender_properties

__all__ = ["CLASSES"]

_WITH_RECORD = BoolProperty(
    name="Record",
    description="Write the catalogue record and how the object was made into the file. Without it, an imported PLY "
    "that was not edited is written as it was",
    default=True,
)
_WITH_FAR = BoolProperty(
    name="Far Gaussians",
    description="Include the Gaussians of a whole scene that lie far outside of what the photos show, which make other "
    "programs show the scene as a dot",
)


@blender_properties
class HERITAGE_OT_export_objects(bpy.types.Operator):
    """Export each object to its own file, with its placement, scale and threshold in this scene"""

    bl_idname = "heritage.export_objects"
    bl_label = "Export Gaussian Objects"
    bl_options = {"PRESET"}

    directory: Annotated[
        str, StringProperty(name="Folder", description="Folder for the exported files", subtype="DIR_PATH")
    ]
    format: Annotated[
        str,
        EnumProperty(
            name="Format",
            items=[
                ("PLY", "PLY", "Standard file of 3D Gaussian splatting, -Y up as its viewers expect"),
                ("GLB", "glTF", "Binary glTF with KHR_gaussian_splatting, Y up"),
                ("SPZ", "SPZ", "Compressed to a sixth of the size, with some loss and without a record"),
                (
                    "SOG",
                    "SOG",
                    "For the web, up to a twentieth of the size, with some loss, -Y up as its viewers expect",
                ),
                ("USD", "USD", "OpenUSD 26.03 or newer, ParticleField3DGaussianSplat, Z up"),
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
    origin: Annotated[
        str,
        EnumProperty(
            name="Origin",
            items=[
                ("WORLD", "World", "Each object stands where it stands in this scene"),
                ("OBJECT", "Object", "The origin of each object is that of its file"),
            ],
        ),
    ]
    with_record: Annotated[bool, _WITH_RECORD]
    with_far: Annotated[bool, _WITH_FAR]
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
            ExportOptions(self.with_record, self.with_far, self.origin == "OBJECT"),
            overwrite=self.overwrite,
        )
        self.report({"INFO"}, f"Wrote {', '.join(file.name for file in files)}.")
        return {"FINISHED"}

    def _objects(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        if self.scope == "SELECTED":
            return [obj for obj in context.scene.objects if obj.select_get() and can_be_exported(obj)]
        return heritage_objects(context.scene, {"ALL": "OBJECT", "SCENE": "SCENE"}[self.scope])


@blender_properties
class HERITAGE_OT_export_splats(bpy.types.Operator, ExportHelper):
    """Export the selected splats, or those of a collection, together to one file"""

    bl_idname = "heritage.export_splats"
    bl_label = "Export Gaussian Splats"
    bl_options = {"PRESET"}

    filename_ext = ".ply"
    filter_glob: Annotated[str, StringProperty(default=";".join(f"*.{name}" for name in FORMATS), options={"HIDDEN"})]
    # The name that Blender gives to the collection whose exporter this is.
    collection: Annotated[str, StringProperty(name="Collection", options={"HIDDEN"})]
    with_record: Annotated[bool, _WITH_RECORD]
    with_far: Annotated[bool, _WITH_FAR]

    def check(self, context: bpy.types.Context) -> bool:
        """Leave the extension that the user gave: it chooses the format."""
        return False

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the file."""
        file = Path(bpy.path.abspath(self.filepath))
        file = file if file.suffix else file.with_suffix(".ply")
        objects = self._objects(context)
        export_together(objects, file, ExportOptions(self.with_record, self.with_far))
        self.report({"INFO"}, f"Wrote {len(objects)} objects to {file.name}.")
        return {"FINISHED"}

    def _objects(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        if not self.collection:
            found = [obj for obj in context.scene.objects if obj.select_get()]
        elif self.collection in bpy.data.collections:
            found = list(bpy.data.collections[self.collection].all_objects)
        else:
            raise ObjectError(f"There is no collection {self.collection}. Choose the collection again.")
        return [obj for obj in found if can_be_exported(obj)]


class HERITAGE_FH_export_splats(bpy.types.FileHandler):
    """Offers the export among the exporters of a collection."""

    bl_idname = "HERITAGE_FH_export_splats"
    bl_label = "Gaussian Splats"
    bl_export_operator = "heritage.export_splats"
    bl_file_extensions = ".ply;.glb;.spz;.sog;.usd"


CLASSES = [HERITAGE_OT_export_objects, HERITAGE_OT_export_splats, HERITAGE_FH_export_splats]
