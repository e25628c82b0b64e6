"""What is asked of the engine to export the meshes of objects, each to its own file, where Blender shows its splats."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy

from ...engine.core.errors import ObjectError, ProjectError
from ...engine.formats import FORMATS, Format
from ..splats.properties import project_of
from ..splats.splats import SplatScene
from .export import ExportOptions, file_names, require_new, require_some
from .moved_projects import is_missing
from .not_stored import has_other_shape
from .placement import is_metric

MESH_FORMATS: tuple[Format, ...] = tuple(
    sorted((one for one in FORMATS if one.write_mesh is not None), key=lambda one: not one.defines_up)
)
"""Formats of meshes. The first is the recommended one."""


def require_meshable(objects: Sequence[bpy.types.Object]) -> None:
    """Raise an error when the engine cannot mesh one of `objects` as Blender shows it.

    Raises
    ------
    ObjectError
        When it is no isolated object of a project, or its project does not have it as it is shown.
    ProjectError
        When its project is missing.
    """
    require_some(objects)
    for obj in objects:
        properties = obj.heritage
        if properties.role != "OBJECT" or not properties.project or not properties.object_id:
            raise ObjectError(
                f"{obj.name} is no isolated object of a project, and a mesh is made of one from its photos. "
                "Export it in a format of Gaussians, or isolate objects first."
            )
        if is_missing(properties):
            raise ProjectError(f"The project {project_of(properties)} is missing. Choose its folder with Find Project.")
    unstored = [obj.name for obj in objects if has_other_shape(obj)]
    if unstored:
        raise ObjectError(
            f"{', '.join(unstored)} is not stored as it is shown, and a mesh is made of what is stored. "
            "Press Store Edits first, or undo the edits."
        )


def mesh_exports(
    objects: Sequence[bpy.types.Object],
    folder: Path,
    kind: Format,
    options: ExportOptions,
    *,
    triangles: int,
    watertight: bool,
    overwrite: bool,
) -> list[tuple[Path, Path, list[str]]]:
    """Return the project, the file, and the arguments of the engine for the mesh of each of `objects`.

    Parameters
    ----------
    folder : Path
        Of the files.
    kind : Format
        One of `MESH_FORMATS`.
    triangles : int
        Largest number of triangles, one of `engine.meshing.settings.LEVELS`.
    watertight : bool
        Whether the surface is closed where no photo saw it.
    overwrite : bool
        Replace existing files.

    Raises
    ------
    ObjectError, ProjectError
        As `require_meshable`.
    DiskError
        When a file exists already and is not to be replaced.
    """
    require_meshable(objects)
    files = file_names(objects, folder, kind.suffixes[0].removeprefix("."))
    if not overwrite:
        require_new([*files, *(file.with_suffix(end) for file in files for end in kind.beside)], folder)
    more = [
        f"--triangles={triangles}",
        *(["--watertight"] if watertight else []),
        *(["--overwrite"] if overwrite else []),
        *([] if options.with_record else ["--record=none"]),
    ]
    exports = []
    for obj, file in zip(objects, files, strict=True):
        project = project_of(obj.heritage)
        matrix = options.placement(obj) @ SplatScene.of(obj).frame
        placed = [
            f"--placement={','.join(map(repr, matrix.ravel().tolist()))}",
            f"--unit={'metre' if is_metric(obj) else 'unknown'}",
        ]
        command = ["export", str(project), f"--object={obj.heritage.object_id}", f"--format={kind.name}"]
        exports.append((project, file, [*command, f"--out={file}", *placed, *more]))
    return exports
