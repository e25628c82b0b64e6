"""Objects on disk: ``objects/<id>/`` with the record, the membership, levels, polished Gaussians and previews."""

from __future__ import annotations

import difflib
import json
import re
import shutil
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError, ObjectError
from ..files import atomic_write, object_file, path_within, write_json
from ..scene import Gaussians, Polished, forget_polished, load_polished, save_polished
from ..settings import to_dict

__all__ = [
    "OBJECT_VERSION",
    "ObjectRecord",
    "delete_object",
    "list_objects",
    "load_fitting_membership",
    "load_levels",
    "load_membership",
    "load_object",
    "new_id",
    "new_name",
    "object_gaussians",
    "save_object",
]

OBJECT_VERSION = 1
_RECORD = "object.json"
_MEMBERSHIP = "membership.npy"
_LEVELS = "levels.npy"


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
        Confidence that this is the object of the prompt, 0 to 1: for a text see `engine.objects.ranking`, otherwise
        SAM's own estimate (1 for a given mask).
    fit : float
        IoU of the object with the best mask of its evidence, in the view of that mask.
    n_gaussians : int
        Gaussians at `threshold`.
    n_scene_gaussians : int
        Gaussians of the scene the membership belongs to.
    evidence : tuple of dict
        Photos with masks of this object, the best first: ``photo``, ``score``. Stored as ``seeds``.
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
    """

    id: str
    name: str
    prompt: dict[str, Any]
    threshold: float
    score: float
    fit: float
    n_gaussians: int
    n_scene_gaussians: int
    evidence: tuple[dict[str, Any], ...] = field(default=(), metadata={"stored_as": "seeds"})
    settings: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0
    created: str = ""
    level: int = 0
    levels: tuple[dict[str, Any], ...] = ()
    refined: tuple[dict[str, Any], ...] = ()


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


def save_object(
    project: Path,
    record: ObjectRecord,
    membership: NDArray[np.float32],
    previews: Sequence[tuple[str, NDArray[np.uint8]]] = (),
    *,
    levels: Sequence[NDArray[np.float32]] = (),
    polished: Polished | None = None,
) -> None:
    """Write an object. It is listed only after all of its files are written.

    Parameters
    ----------
    project : Path
        Project folder.
    record : ObjectRecord
    membership : array of shape [N], float32
        In [0, 1], one value for each Gaussian of the scene.
    previews : sequence of (str, array of shape [H, W] or [H, W, 3], uint8)
        File names without suffix, and pictures.
    levels : sequence of arrays of shape [N], float32
        Memberships of `record.levels`. Stored levels are deleted when the record has none.
    polished : Polished, optional
        The object's polished Gaussians. Stored ones are deleted when this is None.

    Raises
    ------
    DiskError
        When the disk is full or read-only.
    """
    from PIL import Image

    folder = path_within(project, "objects", record.id)
    forget_polished(folder)
    with atomic_write(folder / _MEMBERSHIP) as stream:
        np.save(stream, np.asarray(membership, np.float32), allow_pickle=False)
    if record.levels:
        with atomic_write(folder / _LEVELS) as stream:
            np.save(stream, np.stack(list(levels)).astype(np.float32), allow_pickle=False)
    else:
        (folder / _LEVELS).unlink(missing_ok=True)
    if polished is not None:
        save_polished(folder, polished)
    for name, picture in previews:
        with atomic_write(folder / f"{name}.png") as stream:
            Image.fromarray(picture).save(stream, format="PNG")
    write_json(folder / _RECORD, {"version": OBJECT_VERSION, **to_dict(record)})


def _read_record(file: Path) -> ObjectRecord:
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        if data.pop("version") != OBJECT_VERSION:
            raise FormatError(f"{file} was written by another version of Gaussian Heritage. Isolate the object again.")
        attributes = {known.metadata.get("stored_as", known.name): known.name for known in fields(ObjectRecord)}
        values = {attributes[key]: value for key, value in data.items() if key in attributes}
        for name in ("evidence", "levels", "refined"):
            values[name] = tuple(values.get(name, ()))
        return ObjectRecord(**{**values, "id": file.parent.name})
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FormatError(f"{file} cannot be read: {error}. Delete its folder and isolate the object again.") from error


def list_objects(project: Path) -> list[ObjectRecord]:
    """Return the objects of the project folder `project`, oldest first.

    Raises
    ------
    FormatError
        When an ``object.json`` is damaged, or a folder is a link that leads out of the project.
    """
    folders = sorted(file.parent.name for file in (project / "objects").glob(f"*/{_RECORD}"))
    records = (_read_record(object_file(project, name, _RECORD)) for name in folders)
    return sorted(records, key=lambda record: (record.created, record.id))


def load_object(project: Path, name: str) -> ObjectRecord:
    """Return the object with the id or the name `name`.

    Raises
    ------
    ObjectError
        When there is none; the message lists the existing names.
    """
    records = list_objects(project)
    for matches in (
        lambda record: record.id == name,
        lambda record: record.name == name,
        lambda record: record.name.casefold() == name.casefold(),
    ):
        found = next((record for record in records if matches(record)), None)
        if found is not None:
            return found
    if not records:
        raise ObjectError(f"{project} has no objects yet. Isolate one with `segment` first.")
    names = [record.name for record in records]
    near = difflib.get_close_matches(name, names, n=1)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    raise ObjectError(f"No object is called {name!r}.{hint} Known: {', '.join(names)}.")


def load_membership(project: Path, object_id: str) -> NDArray[np.float32]:
    """Return the membership of the object `object_id`, shape [N], float32, in [0, 1].

    Raises
    ------
    ObjectError
        When there is no such object.
    FormatError
        When its file is damaged.
    """
    file = object_file(project, object_id, _MEMBERSHIP)
    membership = _load(file)
    if membership.ndim != 1:
        raise FormatError(f"{file} does not hold one finite number for each Gaussian. Isolate the object again.")
    return membership


def load_fitting_membership(project: Path, record: ObjectRecord, count: int) -> NDArray[np.float32]:
    """Return the membership of an object in a scene of `count` Gaussians, shape [count], float32, in [0, 1].

    Raises
    ------
    ObjectError
        When it belongs to an earlier training.
    FormatError
        When its file is damaged.
    """
    membership = load_membership(project, record.id)
    if len(membership) != count:
        raise ObjectError(f"{record.name!r} was isolated in an earlier training of this scene. Isolate it again.")
    return membership


def load_levels(project: Path, object_id: str) -> NDArray[np.float32]:
    """Return the memberships of an object's levels, part first, [K, N], float32; one row when it has no levels.

    Raises
    ------
    ObjectError
        When there is no such object.
    FormatError
        When its file is damaged.
    """
    file = object_file(project, object_id, _LEVELS)
    if not file.is_file():
        return load_membership(project, object_id)[None]
    levels = _load(file)
    if levels.ndim != 2:
        raise FormatError(f"{file} does not hold one row for each level. Isolate the object again.")
    return levels


def object_gaussians(project: Path, record: ObjectRecord, gaussians: Gaussians) -> Gaussians:
    """Return an object for export: its Gaussians among the scene's `gaussians`, with their polished values.

    Raises
    ------
    ObjectError
        When it belongs to an earlier training.
    FormatError
        When one of its files is damaged.
    """
    rows = np.flatnonzero(load_fitting_membership(project, record, len(gaussians)) >= record.threshold)
    polished = load_polished(project, record.id)
    return gaussians[rows] if polished is None else polished.with_polished(gaussians[rows], rows)


def _load(file: Path) -> NDArray[np.float32]:
    if not file.is_file():
        raise ObjectError(f"{file} is missing. Isolate the object again with `segment`.")
    try:
        values = np.load(file, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise FormatError(f"{file} cannot be read: {error}. Isolate the object again.") from error
    if not np.isfinite(values).all():
        raise FormatError(f"{file} does not hold one finite number for each Gaussian. Isolate the object again.")
    return np.asarray(values, np.float32)


def delete_object(project: Path, name: str) -> ObjectRecord:
    """Delete the object with the id or the name `name` and return its record.

    Raises
    ------
    ObjectError
        When there is none.
    """
    record = load_object(project, name)
    folder = path_within(project, "objects", record.id)
    # The record is deleted first: an interrupted deletion must not leave an object without membership in the list.
    (folder / _RECORD).unlink()
    shutil.rmtree(folder)
    return record
