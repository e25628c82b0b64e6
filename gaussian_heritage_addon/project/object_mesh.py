"""The textured mesh of an object in Blender: read from the file that the engine wrote, beside the object's splats."""

from __future__ import annotations

from pathlib import Path

import addon_utils
import bpy
import mathutils

from ...engine.core.errors import EnvironmentProblem, ObjectError
from ...engine.core.files import path_within
from ..blender.world_placement import world_matrix
from ..splats.object_meshes import mark_mesh, remove_meshes
from ..splats.splats import SplatScene
from .object_names import ID_KEY

_IMPORTER = "io_scene_gltf2"


def mesh_file(project: Path, object_id: str) -> Path:
    """Return where the engine writes the mesh of an object, until Blender has read it."""
    return path_within(project, "meshes", f"{object_id}.glb")


def require_importer() -> None:
    """Raise `EnvironmentProblem` when Blender's own importer of glTF cannot be used."""
    if addon_utils.enable(_IMPORTER) is None:
        raise EnvironmentProblem(
            "Blender's add-on glTF 2.0 format, which reads meshes, cannot be used. Enable it in the preferences."
        )


def add_mesh(obj: bpy.types.Object, file: Path) -> bpy.types.Object:
    """Add the mesh of `file`, in the normalised world, as a child of the splats `obj`, and return it.

    A mesh that was made of the object before is replaced.

    Raises
    ------
    EnvironmentProblem
        As `require_importer`.
    ObjectError
        When Blender reads no mesh from the file.
    """
    require_importer()
    collection = next(
        (one for one in obj.users_collection if one.get(ID_KEY) == obj.heritage.object_id), obj.users_collection[0]
    )
    before = set(bpy.data.objects)
    try:
        bpy.ops.import_scene.gltf(filepath=str(file))
    except RuntimeError as error:
        raise ObjectError(f"Blender cannot read {file} ({error}). Make the mesh again.") from error
    made = [one for one in bpy.data.objects if one not in before]
    meshes = [one for one in made if one.type == "MESH"]
    if len(meshes) != 1:
        raise ObjectError(f"Blender found {len(meshes)} meshes in {file}, and not one. Make the mesh again.")
    data = meshes[0].data
    # Blender has turned Y up to Z up; the splats have their own frame.
    frame = SplatScene.of(obj).frame @ world_matrix(meshes[0])
    for one in made:
        bpy.data.objects.remove(one)
    data.transform(mathutils.Matrix(frame.tolist()))
    remove_meshes(obj)
    mesh = bpy.data.objects.new(f"{obj.name} mesh", data)
    collection.objects.link(mesh)
    mark_mesh(mesh, obj)
    return mesh
