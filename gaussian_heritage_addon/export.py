"""Writing splat objects to files: one for each, named after it, with its record and how it was made."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy

from ..engine.errors import DiskError, ObjectError
from ..engine.formats import write_glb, write_ply
from .properties import record_of
from .splats import SplatScene

__all__ = ["export_splats"]


def export_splats(
    objects: Sequence[bpy.types.Object], folder: Path, file_format: str, *, overwrite: bool = False
) -> list[Path]:
    """Write each of `objects` into `folder` in world space, at its threshold, and return the files.

    Parameters
    ----------
    objects : sequence of Object
    folder : Path
        Made when missing.
    file_format : {"ply", "glb"}
    overwrite : bool
        Replace files that are there; otherwise nothing is written when one of them is.

    Raises
    ------
    ObjectError
        When there is nothing to export.
    DiskError
        When a file is there already, or cannot be written.
    """
    if not objects:
        raise ObjectError("There is nothing to export. Isolate an object, or select imported splats.")
    files = _file_names(objects, folder, file_format)
    existing = [file.name for file in files if file.exists()]
    if existing and not overwrite:
        raise DiskError(
            f"{folder} already holds {', '.join(existing)}. Allow replacing files, or choose another folder."
        )
    for obj, file in zip(objects, files, strict=True):
        gaussians = SplatScene.of(obj).gaussians(threshold=obj.heritage.threshold)
        record, made = record_of(obj), _how_made(obj, len(gaussians))
        if file_format == "glb":
            extras = {"record": record.as_dict(), "paradata": made}
            write_glb(file, gaussians, name=record.title or obj.name, copyright=record.rights or None, extras=extras)
        else:
            comments = [*record.as_comments(), *(f"{key} {value}" for key, value in made.items())]
            write_ply(file, gaussians, comments=comments)
    return files


def _file_names(objects: Sequence[bpy.types.Object], folder: Path, file_format: str) -> list[Path]:
    names: list[str] = []
    for obj in objects:
        # Blender allows names that file systems do not.
        name = re.sub(r'[<>:"/\\|?*\x00-\x1f]', "_", obj.name).strip(" .") or "object"
        while name.casefold() in (taken.casefold() for taken in names):
            name += "_"
        names.append(name)
    return [folder / f"{name}.{file_format}" for name in names]


def _how_made(obj: bpy.types.Object, count: int) -> dict[str, Any]:
    said = obj.heritage
    made: dict[str, Any] = {"generator": "Gaussian Heritage", "gaussians": count}
    if said.role == "OBJECT":
        made |= {
            "object_id": said.object_id,
            "prompt": said.prompt,
            "confidence": round(said.score, 4),
            "threshold": round(said.threshold, 4),
        }
    return made
