"""Exports splat objects, each to its own file or several to one, with their record and how they were made."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..engine.errors import DiskError, ObjectError, ProjectError, SettingsError
from ..engine.files import path_within
from ..engine.formats import moved_far, transform_gaussians, write_glb, write_ply, write_sog, write_spz, write_usd
from ..engine.scene import Gaussians, far_gaussians, read_camera_set
from .moved_projects import is_missing
from .native_splats import has_native_splats, native_gaussians
from .placement import frame_of_object
from .properties import HeritageObject, project_of, record_of
from .sog_pictures import encode_picture
from .splats import SplatScene
from .stored_file import StoredFile

__all__ = ["FORMATS", "ExportOptions", "can_be_exported", "export_splats", "export_together"]

FORMATS = ("ply", "glb", "spz", "sog", "usd")
"""Formats, named as the extensions of their files."""


@dataclass(frozen=True)
class ExportOptions:
    """How splats are written.

    Attributes
    ----------
    with_record : bool
        Whether the files carry the record and paradata. SPZ has no place for them.
    with_far : bool
        Whether the whole scene of a project includes its far Gaussians, see `engine.scene.far_gaussians`.
    own_origin : bool
        Whether the origin of each object is that of its file, instead of the origin of Blender's world.
    """

    with_record: bool = True
    with_far: bool = False
    own_origin: bool = False


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
    options: ExportOptions | None = None,
    *,
    overwrite: bool = False,
) -> list[Path]:
    """Write each of `objects` to a file in `folder`, in world space and at its threshold, and return the files.

    Parameters
    ----------
    objects : sequence of Object
    folder : Path
        Created when missing.
    file_format : str
        One of `FORMATS`.
    options : ExportOptions, optional
    overwrite : bool
        Replace existing files. If False, nothing is written when one of the files exists.

    Raises
    ------
    ObjectError
        When there is nothing to export.
    DiskError
        When a file exists already, or cannot be written.
    """
    _require_some(objects)
    files = _file_names(objects, folder, file_format)
    existing = [file.name for file in files if file.exists()]
    if existing and not overwrite:
        raise DiskError(
            f"{folder} already contains {', '.join(existing)}. Allow replacing files, or choose another folder."
        )
    options = options or ExportOptions()
    for obj, file in zip(objects, files, strict=True):
        _write(file, _exported(obj, options), obj, options)
    return files


def export_together(objects: Sequence[bpy.types.Object], file: Path, options: ExportOptions | None = None) -> None:
    """Write all of `objects` to one file, whose extension gives the format, in world space; parts as `export_splats`.

    Raises
    ------
    SettingsError
        When the extension is that of no format.
    """
    _require_some(objects)
    if file.suffix.lower().removeprefix(".") not in FORMATS:
        raise SettingsError(f"{file.name} has no extension of a known format. Use .{', .'.join(FORMATS)}.")
    options = replace(options or ExportOptions(), own_origin=False)
    parts = [_exported(obj, options) for obj in objects]
    if len(parts) == 1:
        _write(file, parts[0], objects[0], options)
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
    _write(file, _Exported(whole, {}, there, None), None, options)


def _require_some(objects: Sequence[bpy.types.Object]) -> None:
    if not objects:
        raise ObjectError("There is nothing to export. Isolate an object, or select imported splats.")


def _with_bands(gaussians: Gaussians, count: int) -> Gaussians:
    sh = np.zeros((len(gaussians), count, 3), np.float32)
    sh[:, : gaussians.sh.shape[1]] = gaussians.sh
    return replace(gaussians, sh=sh)


def _exported(obj: bpy.types.Object, options: ExportOptions) -> _Exported:
    if has_native_splats(obj):
        matrix = np.array(obj.matrix_world, dtype=np.float64)
        if options.own_origin:
            matrix[:3, 3] = 0
        return _Exported(native_gaussians(obj), {}, matrix, None)
    splats = SplatScene.of(obj)
    splats.follow_vertices()
    gaussians, membership, stored = splats.local_gaussians(), splats.membership, splats.stored_file
    kept = np.ones(len(gaussians), bool)
    if membership is not None:
        kept &= membership >= np.float32(obj.heritage.threshold)
    if obj.heritage.role == "SCENE" and not options.with_far:
        kept &= ~_far(obj, gaussians)
    extra = {} if stored is None else dict(stored.extra)
    lost = None if stored is None else stored.lost
    if not kept.all():
        gaussians, extra = gaussians[kept], {name: values[kept] for name, values in extra.items()}
        lost = None if lost is None else lost[kept]
    matrix = np.array(obj.matrix_world, dtype=np.float64)
    if options.own_origin:
        matrix[:3, 3] = 0
    return _Exported(gaussians, extra, matrix, stored, lost)


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
    far = far_gaussians(gaussians, read_camera_set(cameras))
    return none if far.all() else far


def _write(file: Path, exported: _Exported, obj: bpy.types.Object | None, options: ExportOptions) -> None:
    """Write Gaussians of one object, or (None) of several, with what is known of them."""
    gaussians, matrix = exported.gaussians, exported.matrix
    record = None if obj is None else record_of(obj)
    paradata = _paradata(obj, len(gaussians))
    name = (record.title if record is not None and options.with_record else "") or (obj.name if obj else file.stem)
    extras = {**({} if record is None else {"record": record.as_dict()}), "paradata": paradata}
    kind = file.suffix.lower()
    if kind == ".spz":
        write_spz(file, gaussians, matrix=matrix)
    elif kind == ".sog":
        write_sog(file, gaussians, encode_picture, matrix=matrix, extras=extras if options.with_record else None)
    elif kind == ".usd":
        metres = 1.0 if obj is not None and frame_of_object(obj).is_metric else None
        data = extras if options.with_record else None
        write_usd(file, gaussians, name=name, metres_per_unit=metres, custom_data=data, matrix=matrix)
    elif kind == ".glb":
        rights = (record.rights or None) if record is not None and options.with_record else None
        data = extras if options.with_record else None
        write_glb(file, gaussians, name=name, copyright=rights, extras=data, matrix=matrix)
    else:
        comments = [*([] if record is None else record.as_comments()), *(f"{k} {v}" for k, v in paradata.items())]
        stored = exported.stored
        # A file without a record is that from which the object came, as far as it was not edited.
        header = () if stored is None or options.with_record else _usable_header(stored, gaussians)
        write_ply(
            file,
            gaussians,
            comments=comments if options.with_record else (),
            up=stored.up if stored is not None and header else "-y",
            matrix=matrix,
            extra=exported.extra,
            header=header,
            lost=exported.lost,
        )


def _usable_header(stored: StoredFile, gaussians: Gaussians) -> tuple[str, ...]:
    """Return the header of the object's file, or nothing where it does not describe these Gaussians."""
    rest = sum(line.startswith("property") and " f_rest_" in line for line in stored.header)
    has_rows = any(line.startswith("element vertex") for line in stored.header)
    return stored.header if has_rows and rest == 3 * (gaussians.sh.shape[1] - 1) else ()


def _file_names(objects: Sequence[bpy.types.Object], folder: Path, file_format: str) -> list[Path]:
    names: list[str] = []
    for obj in objects:
        # Blender allows characters in names that file systems do not.
        name = re.sub(r'[<>:"/\\|?*\x00-\x1f]', "_", obj.name).strip(" .") or "object"
        while name.casefold() in (used.casefold() for used in names):
            name += "_"
        names.append(name)
    return [folder / f"{name}.{file_format}" for name in names]


def _paradata(obj: bpy.types.Object | None, count: int) -> dict[str, Any]:
    paradata: dict[str, Any] = {"generator": "Gaussian Heritage", "gaussians": count}
    if obj is None:
        return paradata
    properties: HeritageObject = obj.heritage
    paradata["unit"] = frame_of_object(obj).unit
    if properties.role == "OBJECT":
        paradata |= {
            "object_id": properties.object_id,
            "prompt": properties.prompt,
            "confidence": round(properties.score, 4),
            "threshold": round(properties.threshold, 4),
        }
    return paradata
