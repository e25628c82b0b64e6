"""Make a textured mesh of an isolated object, beside its splats."""

from __future__ import annotations

import bpy

from ..gaussian_heritage_addon.blender.typed_properties import call_properties
from ..gaussian_heritage_addon.project.mesh_export import require_meshable
from ..gaussian_heritage_addon.project.object_mesh import mesh_file, require_importer
from ..gaussian_heritage_addon.splats.properties import project_of
from .project_operator import WATERTIGHT, ProjectOperator, listed_object, start_job


@call_properties
class HERITAGE_OT_make_mesh(ProjectOperator, bpy.types.Operator):
    """Make a mesh of the object, with a texture from the photos, in its collection. Other programs open it, too"""

    bl_idname = "heritage.make_mesh"
    bl_label = "Make Mesh"

    watertight: bool = WATERTIGHT

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the engine."""
        obj = listed_object(context.scene)
        require_meshable([obj])
        require_importer()
        project, object_id = project_of(context.scene.heritage), obj.heritage.object_id
        file = mesh_file(project, object_id)
        options = ["--format=glb-mesh", "--frame=world", "--origin=scene", "--overwrite", f"--out={file}"]
        options += ["--watertight"] if self.watertight else []
        return start_job(self, "mesh", project, "export", str(project), f"--object={object_id}", *options)


CLASSES = [HERITAGE_OT_make_mesh]
