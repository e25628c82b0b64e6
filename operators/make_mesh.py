"""Make a textured mesh of an isolated object, beside its splats."""

from __future__ import annotations

from typing import Annotated

import bpy
from bpy.props import BoolProperty

from ..engine.core.errors import ObjectError
from ..gaussian_heritage_addon.blender.typed_properties import blender_properties
from ..gaussian_heritage_addon.jobs import job_runner
from ..gaussian_heritage_addon.project.hand_edits import edited_objects
from ..gaussian_heritage_addon.project.object_mesh import mesh_file, require_importer
from ..gaussian_heritage_addon.splats.properties import active_object, project_of
from .needing_project import is_project_open

__all__ = ["CLASSES"]


@blender_properties
class HERITAGE_OT_make_mesh(bpy.types.Operator):
    """Make a mesh of the object, with a texture from the photos, in its collection. Other programs open it, too"""

    bl_idname = "heritage.make_mesh"
    bl_label = "Make Mesh"

    watertight: Annotated[
        bool,
        BoolProperty(
            name="Watertight",
            description="Close the mesh where no photo saw the object, for printing. What is made up has a material "
            "of its own",
            options={"SKIP_SAVE"},
        ),
    ]

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether a project is open."""
        return is_project_open(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the engine."""
        obj = active_object(context.scene)
        if obj is None or not obj.heritage.object_id:
            raise ObjectError("Select an isolated object in the list first.")
        if obj in edited_objects(context.scene):
            raise ObjectError(f"{obj.name} was edited by hand. Store its edits first, or undo them.")
        require_importer()
        project, object_id = project_of(context.scene.heritage), obj.heritage.object_id
        file = mesh_file(project, object_id)
        options = ["--format=glb-mesh", "--frame=world", "--origin=scene", "--overwrite", f"--out={file}"]
        options += ["--watertight"] if self.watertight else []
        state = job_runner.start("mesh", project, "export", str(project), f"--object={object_id}", *options)
        message = "Working in the background; see the Heritage panel." if state is None else state.message
        self.report({"INFO"}, message)
        return {"FINISHED"}


CLASSES = [HERITAGE_OT_make_mesh]
