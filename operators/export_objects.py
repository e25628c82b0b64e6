"""File > Export: each object as Gaussians or as a mesh in its own file, with its record; several splats as one file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_n
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..engine.core.errors import ObjectError
from ..engine.formats import Format
from ..engine.meshing.settings import LEVELS, MeshSettings
from ..gaussian_heritage_addon.blender.drawn_text import draw_text
from ..gaussian_heritage_addon.blender.typed_properties import blender_properties
from ..gaussian_heritage_addon.jobs import job_runner
from ..gaussian_heritage_addon.language.translations import translated
from ..gaussian_heritage_addon.project.export import (
    FORMATS,
    ExportOptions,
    can_be_exported,
    choose_objects,
    clean_name,
    export_formats,
    export_splats,
    export_together,
)
from ..gaussian_heritage_addon.project.mesh_export import MESH_FORMATS, mesh_exports
from ..gaussian_heritage_addon.splats.selection import heritage_objects
from .project_operator import WATERTIGHT

_MAX_NAMES = 12
"""Names of objects that are shown."""
_KINDS = {one.name.upper().replace("-", "_"): one for one in (*FORMATS, *MESH_FORMATS)}
_ITEMS = [(name, one.label, one.description, "", number) for number, (name, one) in enumerate(_KINDS.items())]
_ITEMS_WITHOUT_USD = [item for item in _ITEMS if not _KINDS[item[0]].needs_openusd]
_LEVELS = [(str(count), f"{count:,}", "") for count in LEVELS]
_SUFFIXES = tuple(one.suffixes[0] for one in FORMATS)


def _format_items(
    operator: bpy.types.Operator, context: bpy.types.Context | None
) -> list[tuple[str, str, str, str, int]]:
    """Return the formats that can be written. Blender needs lists that live as long as it shows them."""
    return _ITEMS if len(export_formats()) == len(FORMATS) else _ITEMS_WITHOUT_USD


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
    """Export each object to its own file, as Gaussians or as a mesh, with its placement and scale in this scene"""

    bl_idname = "heritage.export_objects"
    bl_label = "Export Gaussian Objects"
    bl_options = {"PRESET"}

    directory: str = StringProperty(name="Folder", description="Folder for the exported files", subtype="DIR_PATH")
    format: str = EnumProperty(name="Format", description="Format of the files", items=_format_items)
    scope: str = EnumProperty(
        name="Objects",
        items=[
            ("ALL", "All", "All isolated objects that are shown, without the background"),
            ("SELECTED", "Selected", "Selected splats, including whole scenes"),
            ("SCENE", "Scene", "The whole scene"),
        ],
    )
    with_hidden: bool = BoolProperty(
        name="Hidden Objects", description="With All: include the objects whose eye is closed"
    )
    with_background: bool = BoolProperty(
        name="Background", description="With All: include the background, which surrounds the objects"
    )
    origin: str = EnumProperty(
        name="Origin",
        items=[
            ("WORLD", "World", "Each object stands where it stands in this scene"),
            ("OBJECT", "Object", "The origin of each object is that of its file"),
        ],
    )
    triangles: str = EnumProperty(
        name="Triangles",
        description="Largest number of triangles of a mesh: for the web, for looking closely, as fine as photos allow",
        items=_LEVELS,
        default=str(MeshSettings.triangles),
    )
    watertight: bool = WATERTIGHT
    with_record: bool = _WITH_RECORD
    with_far: bool = _WITH_FAR
    overwrite: bool = BoolProperty(name="Replace Files", description="Replace existing files")
    filter_folder: bool = BoolProperty(default=True, options={"HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Open the file browser to select the folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the options, and which objects they mean."""
        layout, is_mesh = self.layout, _KINDS[self.format].write_mesh is not None
        for name in ("format", *(("triangles", "watertight") if is_mesh else ()), "scope"):
            layout.prop(self, name)
        if self.scope == "ALL":
            layout.prop(self, "with_hidden")
            layout.prop(self, "with_background")
        box = layout.box()
        objects, left_out = self._chosen(context)
        draw_text(box, _said(pgettext_n("Objects: {}, {}"), objects), icon="EXPORT")
        if left_out:
            draw_text(box, _said(pgettext_n("Left out: {}, {}"), left_out), icon="HIDE_ON")
        for name in ("origin", "with_record", *(() if is_mesh else ("with_far",)), "overwrite"):
            layout.prop(self, name)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the files, or start the engine for meshes."""
        objects, left_out = self._chosen(context)
        if left_out and not objects:
            raise ObjectError(
                f"All {len(left_out)} objects are hidden, so nothing is exported. Open their eyes in the list, or "
                "choose Hidden Objects."
            )
        folder, kind = Path(bpy.path.abspath(self.directory)), _KINDS[self.format]
        options = ExportOptions(self.with_record, self.with_far, self.origin == "OBJECT")
        if kind.write_mesh is not None:
            files = self._start_meshes(objects, folder, kind, options)
            told = "Meshes are made in the background; see the Heritage panel:"
        else:
            files = export_splats(objects, folder, kind.name, options, overwrite=self.overwrite)
            told = f"Wrote {len(files)} {'file' if len(files) == 1 else 'files'}:"
        told += f" {', '.join(file.name for file in files)}."
        if left_out:
            told += f" Left out: {', '.join(map(_with_reason, left_out))}."
        self.report({"INFO"}, told)
        return {"FINISHED"}

    def _start_meshes(
        self, objects: Sequence[bpy.types.Object], folder: Path, kind: Format, options: ExportOptions
    ) -> list[Path]:
        """Ask the engine for the meshes, one after the other, and return the files that it writes."""
        exports = mesh_exports(
            objects,
            folder,
            kind,
            options,
            triangles=int(self.triangles),
            watertight=self.watertight,
            overwrite=self.overwrite,
        )
        for project, _, arguments in exports:
            job_runner.start("export", project, *arguments)
        return [file for _, file, _ in exports]

    def _chosen(self, context: bpy.types.Context) -> tuple[list[bpy.types.Object], list[tuple[bpy.types.Object, str]]]:
        """Return the objects to export, and those that are left out with the reason."""
        if self.scope == "SELECTED":
            return [obj for obj in context.scene.objects if obj.select_get() and can_be_exported(obj)], []
        if self.scope == "SCENE":
            return heritage_objects(context.scene, "SCENE"), []
        return choose_objects(context.scene, with_hidden=self.with_hidden, with_background=self.with_background)


def _said(text: str, objects: Sequence[bpy.types.Object | tuple[bpy.types.Object, str]]) -> str:
    """Return a text with the number of objects, and the names of the first of them."""
    names = [_with_reason(one) if isinstance(one, tuple) else clean_name(one) for one in objects[:_MAX_NAMES]]
    more = [translated("... and {} more", len(objects) - _MAX_NAMES)] if len(objects) > _MAX_NAMES else []
    return translated(text, len(objects), ", ".join([*names, *more]))


def _with_reason(left_out: tuple[bpy.types.Object, str]) -> str:
    obj, reason = left_out
    return f"{clean_name(obj)} ({translated(reason)})"


@blender_properties
class HERITAGE_OT_export_splats(bpy.types.Operator, ExportHelper):
    """Export the selected splats, or those of a collection, together to one file"""

    bl_idname = "heritage.export_splats"
    bl_label = "Export Gaussian Splats"
    bl_options = {"PRESET"}

    filename_ext = _SUFFIXES[0]
    filter_glob: str = StringProperty(default=";".join(f"*{suffix}" for suffix in _SUFFIXES), options={"HIDDEN"})
    # The name that Blender gives to the collection whose exporter this is.
    collection: str = StringProperty(name="Collection", options={"HIDDEN"})
    with_record: bool = _WITH_RECORD
    with_far: bool = _WITH_FAR

    def check(self, context: bpy.types.Context) -> bool:
        """Leave the extension that the user gave: it chooses the format."""
        return False

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the file."""
        file = Path(bpy.path.abspath(self.filepath))
        file = file if file.suffix else file.with_suffix(self.filename_ext)
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
    bl_file_extensions = ";".join(_SUFFIXES)


CLASSES = [HERITAGE_OT_export_objects, HERITAGE_OT_export_splats, HERITAGE_FH_export_splats]
