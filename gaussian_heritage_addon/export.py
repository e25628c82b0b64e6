"""Exports splat objects: one file per object, with its catalogue record and paradata (how it was made)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy

from ..engine.errors import DiskError, ObjectError
from ..engine.formats import write_glb, write_ply
from .placement import frame_of_object
from .properties import HeritageObject, record_of
from .splats import SplatScene

__all__ = ["export_splats"]


def export_splats(
    objects: Sequence[bpy.types.Object], folder: Path, file_format: str, *, overwrite: bool = False
) -> list[Path]:
    """Write each of `objects` to a file in `folder`, in world space and at its threshold, and return the files.

    Parameters
    ----------
    objects : sequence of Object
    folder : Path
        Created when missing.
    file_format : {"ply", "glb"}
    overwrite : bool
        Replace existing files. If False, nothing is written when one of the files exists.

    Raises
    ------
    ObjectError
        When there is nothing to export.
    DiskError
        When a file exists already, or cannot be written.
    """
    if not objects:
        raise ObjectError("There is nothing to export. Isolate an object, or select imported splats.")
    files = _file_names(objects, folder, file_format)
    existing = [file.name for file in files if file.exists()]
    if existing and not overwrite:
        raise DiskError(
            f"{folder} already contains {', '.join(existing)}. Allow replacing files, or choose another folder."
        )
    for obj, file in zip(objects, files, strict=True):
        gaussians = SplatScene.of(obj).gaussians(threshold=obj.heritage.threshold)
        record, paradata = record_of(obj), _paradata(obj, len(gaussians))
        if file_format == "glb":
            extras = {"record": record.as_dict(), "paradata": paradata}
            write_glb(file, gaussians, name=record.title or obj.name, copyright=record.rights or None, extras=extras)
        else:
            comments = [*record.as_comments(), *(f"{key} {value}" for key, value in paradata.items())]
            write_ply(file, gaussians, comments=comments)
    return files


def _file_names(objects: Sequence[bpy.types.Object], folder: Path, file_format: str) -> list[Path]:
    names: list[str] = []
    for obj in objects:
        # Blender allows characters in names that file systems do not.
        name = re.sub(r'[<>:"/\\|?*\x00-\x1f]', "_", obj.name).strip(" .") or "object"
        while name.casefold() in (used.casefold() for used in names):
            name += "_"
        names.append(name)
    return [folder / f"{name}.{file_format}" for name in names]


def _paradata(obj: bpy.types.Object, count: int) -> dict[str, Any]:
    properties: HeritageObject = obj.heritage
    unit = frame_of_object(obj)
    paradata: dict[str, Any] = {"generator": "Gaussian Heritage", "gaussians": count, "unit": unit.unit}
    if properties.role == "OBJECT":
        paradata |= {
            "object_id": properties.object_id,
            "prompt": properties.prompt,
            "confidence": round(properties.score, 4),
            "threshold": round(properties.threshold, 4),
        }
    return paradata
