"""The record of an object in ``object.json``."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from ...core.errors import FormatError
from ...core.files import FILE_RECORD, FileRecord, Schema, object_file, optional, read_versioned, write_json
from ...core.settings import to_dict
from ..provenance import RUN

RECORD_FILE = "object.json"
MEMBERSHIP_FILE, LEVELS_FILE, DETAIL_FILE = "membership.npy", "levels.npy", "detail.npz"
COMPUTED_FILES = (MEMBERSHIP_FILE, LEVELS_FILE, DETAIL_FILE)
"""Files of an object whose size and hash are in its record."""
EVIDENCE_FILE = "evidence.png"
"""Mask of the object in the photo that it was found in; what was made by hand has none."""
PICTURE_FILE = "picture.png"
"""A picture of an object with an unsure name on a photo; only such objects have it."""
_ADVICE = "Delete its folder and isolate the object again."

_POINTS: Schema = [{"photo": str, "x": float, "y": float}]
_VERSION = 1
_SCHEMA: Schema = {
    "version": int,
    "name": str,
    "prompt": dict,
    "threshold": float,
    "score": float,
    "fit": float,
    "n_gaussians": int,
    "n_scene_gaussians": int,
    "evidence": optional([{"photo": str, "score": float}]),
    "settings": optional(dict),
    "seconds": optional(float),
    "created": optional(str),
    "level": optional(int),
    "levels": optional([{"n_gaussians": int}]),
    "refined": optional([{"clicks": optional(_POINTS), "not": optional(_POINTS)}]),
    "detail": optional((dict, None)),
    "files": {str: FILE_RECORD},
    "run": optional((RUN, None)),
}


@dataclass(frozen=True)
class ObjectRecord:
    """An object of a scene.

    Attributes
    ----------
    id : str
        Name of the object's folder, safe in every file system, e.g. ``"vase-2"``. What the file says is ignored.
    name : str
        Name given by the user, or made from the prompt.
    prompt : dict
        See `engine.objects.prompts.describe_prompt`.
    threshold : float
        A Gaussian belongs to the object when its membership is at least this.
    score : float
        Confidence that this is the object of the prompt, 0 to 1: for a text see `engine.objects.looks`, otherwise
        SAM's own estimate (1 for a given mask).
    fit : float
        IoU of the object with the best mask of its evidence, in the view of that mask.
    n_gaussians : int
        Gaussians at `threshold`.
    n_scene_gaussians : int
        Gaussians of the scene the membership belongs to.
    evidence : tuple of dict
        Photos with masks of this object, the best first: ``photo``, ``score``.
    settings : dict
        `SegmentSettings` of the extraction.
    seconds : float
        Wall time of the extraction.
    created : str
        ISO 8601 time in UTC.
    level : int
        Index of the level that is the object.
    levels : tuple of dict
        Versions from part to whole, each contained in the next: ``n_gaussians``. Empty when there is only one.
    refined : tuple of dict
        Later corrections, oldest first: ``clicks`` and ``not``, lists of ``photo``, ``x``, ``y``.
    detail : dict or None
        What detailing it came to, see `engine.objects.detail.DetailResult`; None where it was not asked for.
    run : dict or None
        What ran, see `engine.project.provenance.describe_run`; None where it is not known.
    """

    id: str
    name: str
    prompt: dict[str, Any]
    threshold: float
    score: float
    fit: float
    n_gaussians: int
    n_scene_gaussians: int
    evidence: tuple[dict[str, Any], ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0
    created: str = ""
    level: int = 0
    levels: tuple[dict[str, Any], ...] = ()
    refined: tuple[dict[str, Any], ...] = ()
    detail: dict[str, Any] | None = None
    run: dict[str, Any] | None = None


def new_id(name: str, taken: Sequence[str]) -> str:
    """Return a folder name made from `name` that is valid in every file system and not in `taken`.

    Letters and digits of every script are kept in lower case; any run of other characters becomes one ``-``. A number
    is added when the name is taken. Names are compared without case, so no two ids differ by case alone.
    """
    folded = unicodedata.normalize("NFC", unicodedata.normalize("NFKC", name).casefold())
    slug = re.sub(r"[\W_]+", "-", folded, flags=re.UNICODE).strip("-")
    # 60 letters of 3 bytes stay below every file system's 255 bytes.
    slug = slug[:60].strip("-") or "object"
    if re.fullmatch(r"con|prn|aux|nul|com\d|lpt\d", slug):
        slug = f"object-{slug}"
    return _numbered(slug, {other.casefold() for other in taken})


def new_name(name: str, taken: Sequence[str]) -> str:
    """Return `name`, with ``-2``, ``-3``... when another object has that name."""
    name = " ".join(name.split()) or "object"
    return _numbered(name, set(taken))


def _numbered(name: str, taken: set[str]) -> str:
    if name.casefold() not in taken and name not in taken:
        return name
    number = 2
    while f"{name}-{number}" in taken or f"{name}-{number}".casefold() in taken:
        number += 1
    return f"{name}-{number}"


def write_record(file: Path, record: ObjectRecord, files: dict[str, FileRecord]) -> None:
    """Write ``object.json``.

    Parameters
    ----------
    files : dict of str to FileRecord
        Size and SHA-256 of the object's files that are computed, by name.

    Raises
    ------
    DiskError
        When the disk is full or read-only.
    """
    write_json(file, {"version": _VERSION, **to_dict(record), "files": files})


def rename_object(project: Path, object_id: str, name: str) -> str:
    """Give an object of the project folder `project` another name; its id and files stay.

    Returns
    -------
    str
        The name that it has now: as `new_name`, so that no two objects have the same.

    Raises
    ------
    FormatError
        When its record is damaged.
    DiskError
        When the record cannot be written.
    """
    file = object_file(project, object_id, RECORD_FILE)
    others = [other for other in (project / "objects").glob(f"*/{RECORD_FILE}") if other.parent.name != object_id]
    name = new_name(name, [read_record(other).name for other in others])
    record = read_record(file)
    if record.name != name:
        write_record(file, replace(record, name=name), recorded_files(file))
    return name


def read_record(file: Path) -> ObjectRecord:
    """Return the object that an ``object.json`` describes; its id is the name of the folder.

    Raises
    ------
    FormatError
        When the file is damaged or of a format number that is not known.
    """
    data = _read(file)
    names = {known.name for known in fields(ObjectRecord)}
    values = {key: value for key, value in data.items() if key in names}
    for name in ("evidence", "levels", "refined"):
        values[name] = tuple(values.get(name, ()))
    if not 0.0 <= values["threshold"] <= 1.0:
        raise FormatError(
            f"{file} cannot be read: `threshold` must be from 0 to 1, got {values['threshold']:g}. {_ADVICE}"
        )
    return ObjectRecord(**{**values, "id": file.parent.name})


def recorded_files(file: Path) -> dict[str, FileRecord]:
    """Return size and SHA-256 of the files that an ``object.json`` records.

    Raises
    ------
    FormatError
        As for `read_record`.
    """
    files: dict[str, FileRecord] = _read(file)["files"]
    return files


def _read(file: Path) -> dict[str, Any]:
    return read_versioned(file, _SCHEMA, version=_VERSION, advice=_ADVICE)
