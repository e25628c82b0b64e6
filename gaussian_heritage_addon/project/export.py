"""Exports splat objects, each to its own file or several to one, with their record and how they were made."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.app.translations import pgettext_n
from numpy.typing import NDArray

from ...engine.core.errors import DiskError, ObjectError, ProjectError, SettingsError
from ...engine.core.files import path_within
from ...engine.formats import (
    DEFAULT_FORMAT,
    FileFacts,
    Format,
    WritingTools,
    moved_far,
    transform_gaussians,
    write_scene,
)
from ...engine.formats import FORMATS as ALL_FORMATS
from ...engine.scene import Gaussians, far_gaussians, read_camera_set
from ..blender.world_placement import world_matrix
from ..splats.native_splats import has_native_splats, native_gaussians
from ..splats.properties import HeritageObject, project_of, record_of
from ..splats.selection import heritage_objects
from ..splats.sog_pictures import encode_picture
from ..splats.splats import SplatScene
from ..splats.stored_file import StoredFile
from .moved_projects import is_missing
from .object_geometry import moved_gaussians
from .object_state import HeritageState
from .placement import frame_of_object, frame_of_whole
from .usd_export import can_write_usd, write_usd_file

FORMATS: tuple[Format, ...] = tuple(
    sorted((one for one in ALL_FORMATS if one.write is not None), key=lambda one: one.name != DEFAULT_FORMAT)
)
"""Formats that are written here. The first is the default."""


def export_formats() -> tuple[str, ...]:
    """Return the formats that can be written now: USD needs OpenUSD in Blender or in the engine."""
    return tuple(one.name for one in FORMATS if not one.needs_openusd or can_write_usd())


def choose_objects(
    scene: bpy.types.Scene, *, with_hidden: bool, with_background: bool
) -> tuple[list[bpy.types.Object], list[tuple[bpy.types.Object, str]]]:
    """Return which isolated objects of `scene` are exported when all are asked for, and which are not, and why.

    Parameters
    ----------
    with_hidden : bool
        Include objects whose eye is closed, in the list or in the outliner.
    with_background : bool
        Include backgrounds, which surround the objects. Where they are the only objects, they are always included.

    Returns
    -------
    list of Object, and list of (Object, str)
        The reason is ``"hidden"`` or ``"background"``.
    """
    every = heritage_objects(scene, "OBJECT")
    only_background = all(obj.heritage.kind == "background" for obj in every)
    chosen, left_out = [], []
    for obj in every:
        if obj.heritage.kind == "background":
            reason = "" if with_background or only_background else pgettext_n("background")
        else:
            reason = pgettext_n("hidden") if _is_closed(scene, obj) and not with_hidden else ""
        if reason:
            left_out.append((obj, reason))
        else:
            chosen.append(obj)
    return chosen, left_out


def _is_closed(scene: bpy.types.Scene, obj: bpy.types.Object) -> bool:
    """Return whether the user has hidden an object; while the whole scene is shown, all objects are hidden for it."""
    if obj.heritage.hidden or obj.hide_get():
        return True
    return scene.heritage.show == "OBJECTS" and not obj.visible_get()


def clean_name(obj: bpy.types.Object) -> str:
    """Return the name that splats have in their project, otherwise without Blender's number for names in use (.001).

    A name of numbers only (``1906.123``) stays as it is.
    """
    state: HeritageState = obj.heritage_state
    if state.object_name and obj.name == state.shown_name:
        return state.object_name
    numbered = re.fullmatch(r"(.*[^\d.].*)\.\d{3}", obj.name)
    return obj.name if numbered is None else numbered[1]


@dataclass(frozen=True)
class ExportOptions:
    """How splats are written.

    Attributes
    ----------
    with_record : bool
        Whether the files carry the record and paradata, where their format has a place for them.
    with_far : bool
        Whether the whole scene of a project includes its far Gaussians, see `engine.scene.far_gaussians`.
    own_origin : bool
        Whether the origin of each object is that of its file, instead of the origin of Blender's world.
    """

    with_record: bool = True
    with_far: bool = False
    own_origin: bool = False

    def placement(self, obj: bpy.types.Object) -> NDArray[np.float64]:
        """Return the transform [4, 4] from the frame of `obj` to that of its file, Z up."""
        matrix = world_matrix(obj)
        if self.own_origin:
            matrix[:3, 3] = 0
        return matrix


DEFAULT_OPTIONS = ExportOptions()


@dataclass(frozen=True)
class _Exported:
    """Gaussians in the frame of their object, and the transform to that of the file, Z up."""

    gaussians: Gaussians
    extra: dict[str, NDArray[Any]]
    matrix: NDArray[np.float64]
    stored: StoredFile | None
    lost: NDArray[np.float64] | None = None


def can_be_exported(obj: bpy.types.Object) -> bool:
    """Return whether `obj` has Gaussians: the add-on's, or those of Blender's own type."""
    return SplatScene.is_splats(obj) or has_native_splats(obj)


def export_splats(
    objects: Sequence[bpy.types.Object],
    folder: Path,
    file_format: str,
    options: ExportOptions = DEFAULT_OPTIONS,
    *,
    overwrite: bool = False,
) -> list[Path]:
    """Write each of `objects` to a file in `folder`, in world space and at its threshold, and return the files.

    Parameters
    ----------
    folder : Path
        Created when missing.
    file_format : str
        Name of one of `FORMATS`.
    overwrite : bool
        Replace existing files. If False, nothing is written when one of the files exists.

    Raises
    ------
    ObjectError
        When there is nothing to export.
    DiskError
        When a file exists already, or cannot be written.
    """
    require_some(objects)
    files = file_names(objects, folder, file_format)
    if not overwrite:
        require_new(files, folder)
    for obj, file in zip(objects, files, strict=True):
        _write(file, _exported(obj, options), [obj], options)
    return files


def export_together(objects: Sequence[bpy.types.Object], file: Path, options: ExportOptions = DEFAULT_OPTIONS) -> None:
    """Write all of `objects` to one file, whose extension gives the format, in world space; parts as `export_splats`.

    Raises
    ------
    SettingsError
        When the extension is that of no format.
    """
    require_some(objects)
    if _format_of(file) is None:
        raise SettingsError(f"{file.name} has no extension of a known format. Use .{', .'.join(export_formats())}.")
    options = replace(options, own_origin=False)
    parts = [_exported(obj, options) for obj in objects]
    if len(parts) == 1:
        _write(file, parts[0], objects, options)
        return
    bands = max(part.gaussians.sh.shape[1] for part in parts)
    # Float32 would round what is far away: there, the Gaussians are put together near 0 first.
    far = next((part.matrix[:3, 3] for part in parts if moved_far(part.gaussians, part.matrix)), np.zeros(3))
    there = np.eye(4)
    there[:3, 3] = np.round(far)
    whole: Gaussians | None = None
    for part in parts:
        placed = _with_bands(transform_gaussians(part.gaussians, np.linalg.inv(there) @ part.matrix), bands)
        whole = placed if whole is None else whole.joined(placed)
    assert whole is not None
    _write(file, _Exported(whole, {}, there, None), objects, options)


def require_some(objects: Sequence[bpy.types.Object]) -> None:
    """Raise `ObjectError` when there is nothing to export."""
    if not objects:
        raise ObjectError("There is nothing to export. Isolate an object, or select imported splats.")


def _with_bands(gaussians: Gaussians, count: int) -> Gaussians:
    sh = np.zeros((len(gaussians), count, 3), np.float32)
    sh[:, : gaussians.sh.shape[1]] = gaussians.sh
    return replace(gaussians, sh=sh)


def _exported(obj: bpy.types.Object, options: ExportOptions) -> _Exported:
    if has_native_splats(obj):
        return _Exported(native_gaussians(obj), {}, options.placement(obj), None)
    splats = SplatScene.of(obj)
    splats.follow_vertices()
    gaussians, kept, stored = splats.local_gaussians(), splats.shown, splats.stored_file
    if obj.heritage.role == "SCENE" and not options.with_far:
        kept &= ~_far(obj, gaussians)
    extra = {} if stored is None else dict(stored.extra)
    lost = None if stored is None else stored.lost
    if not kept.all():
        gaussians, extra = gaussians[kept], {name: values[kept] for name, values in extra.items()}
        lost = None if lost is None else lost[kept]
    return _Exported(gaussians, extra, options.placement(obj), stored, lost)


def _far(obj: bpy.types.Object, gaussians: Gaussians) -> NDArray[np.bool_]:
    none = np.zeros(len(gaussians), bool)
    if not obj.heritage.project:
        return none
    if is_missing(obj.heritage):
        raise ProjectError(
            f"The project {project_of(obj.heritage)} is missing, so the far Gaussians of {obj.name} cannot be told. "
            "Choose its folder with Find Project, or export with far Gaussians."
        )
    cameras = path_within(project_of(obj.heritage), "cameras")
    if not (cameras / "cameras.json").is_file():
        return none
    in_project = moved_gaussians(gaussians, np.linalg.inv(frame_of_whole(obj)))
    far = far_gaussians(in_project, read_camera_set(cameras))
    return none if far.all() else far


def _write(file: Path, exported: _Exported, objects: Sequence[bpy.types.Object], options: ExportOptions) -> None:
    """Write Gaussians of one object, or of several, with what is known of them."""
    gaussians, matrix = exported.gaussians, exported.matrix
    obj = objects[0] if len(objects) == 1 else None
    record = None if obj is None else record_of(obj)
    paradata = _paradata(objects, len(gaussians))
    title = record.title if record is not None and options.with_record else ""
    name = title or (file.stem if obj is None else clean_name(obj))
    extras = {**({} if record is None else {"record": record.as_dict()}), "paradata": paradata}
    facts = FileFacts(name=name, matrix=matrix, properties=exported.extra, lost=exported.lost)
    if all(frame_of_object(one).is_metric for one in objects):
        facts = replace(facts, metres_per_unit=1.0)
    if options.with_record:
        rights = None if record is None else record.rights or None
        comments = [*([] if record is None else record.as_comments()), *(f"{k} {v}" for k, v in paradata.items())]
        facts = replace(facts, extras=extras, comments=comments, rights=rights)
    elif exported.stored is not None and (header := _usable_header(exported.stored, gaussians)):
        # A file without a record is that from which the object came, as far as it was not edited.
        facts = replace(facts, header=header, header_up=exported.stored.up)
    kind = _format_of(file)
    assert kind is not None
    write_scene(file, gaussians, kind.name, facts, WritingTools(encode_picture, write_usd_file))


def _format_of(file: Path) -> Format | None:
    """Return the format that the extension of a file names."""
    return next((one for one in FORMATS if file.suffix.lower() == one.suffixes[0]), None)


def _usable_header(stored: StoredFile, gaussians: Gaussians) -> tuple[str, ...]:
    """Return the header of the object's file, or nothing where it does not describe these Gaussians."""
    rest = sum(line.startswith("property") and " f_rest_" in line for line in stored.header)
    has_rows = any(line.startswith("element vertex") for line in stored.header)
    return stored.header if has_rows and rest == 3 * (gaussians.sh.shape[1] - 1) else ()


def require_new(files: Sequence[Path], folder: Path) -> None:
    """Raise `DiskError` when one of `files`, of `folder`, exists already."""
    existing = [file.name for file in files if file.exists()]
    if existing:
        raise DiskError(
            f"{folder} already contains {', '.join(existing)}. Allow replacing files, or choose another folder."
        )


def file_names(objects: Sequence[bpy.types.Object], folder: Path, suffix: str) -> list[Path]:
    """Return the files of `objects`, named after their records: the catalogue number, if there is one, and the name."""
    names: list[str] = []
    for obj in objects:
        wanted = " ".join(filter(None, [record_of(obj).catalogue_number.strip(), clean_name(obj)]))
        # Blender and catalogues allow characters in names that file systems do not.
        name = first = re.sub(r'[<>:"/\\|?*\x00-\x1f]', "_", wanted).strip(" .") or "object"
        number = 2
        while name.casefold() in (used.casefold() for used in names):
            name, number = f"{first} {number}", number + 1
        names.append(name)
    return [folder / f"{name}.{suffix}" for name in names]


def _paradata(objects: Sequence[bpy.types.Object], count: int) -> dict[str, Any]:
    units = {frame_of_object(obj).unit for obj in objects}
    unit = units.pop() if len(units) == 1 else "unknown"
    paradata: dict[str, Any] = {"generator": "Gaussian Heritage", "gaussians": count, "unit": unit}
    if len(objects) > 1:
        return paradata
    properties: HeritageObject = objects[0].heritage
    if properties.role == "OBJECT":
        paradata |= {
            "object_id": properties.object_id,
            "prompt": properties.prompt,
            "confidence": round(properties.score, 4),
            "threshold": round(properties.threshold, 4),
        }
    return paradata
