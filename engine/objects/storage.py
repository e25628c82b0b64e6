"""Objects on disk: ``objects/<id>/`` with the record, the membership, levels, detailed Gaussians and previews.

The record holds size and SHA-256 of the computed files, which are checked when they are read; pictures, and the museum
record that the user writes, are not among them. Functions that read an object raise `ObjectError` when there is none,
and `FormatError` when a file is damaged, or its folder is a link that leads out of the project.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..core.arrays import Float32, Mask, Pixels
from ..core.errors import FormatError, HeritageError, ObjectError
from ..core.files import (
    ArraySpec,
    atomic_write,
    delete_derived,
    is_as_recorded,
    object_file,
    path_within,
    read_array,
    record_of,
    replace_together,
)
from ..pictures import write_png
from ..project.objects import (
    COMPUTED_FILES,
    DETAIL_FILE,
    LEVELS_FILE,
    MEMBERSHIP_FILE,
    RECORD_FILE,
    ObjectRecord,
    list_objects,
    load_object,
    object_ids,
    read_record,
    recorded_files,
    taken_ids,
    write_record,
)
from ..scene import Detailed, Gaussians, load_detailed, save_detailed

__all__ = [
    "detail_of",
    "forget_unreadable_record",
    "is_object_intact",
    "list_objects",
    "load_levels",
    "load_membership",
    "load_object",
    "membership_in",
    "object_gaussians",
    "object_ids",
    "save_object",
    "taken_ids",
]

_ADVICE = "Isolate the object again."


def save_object(
    project: Path,
    record: ObjectRecord,
    membership: Float32,
    previews: Sequence[tuple[str, Pixels | Mask]] = (),
    *,
    levels: Sequence[Float32] = (),
    detailed: Detailed | None = None,
) -> None:
    """Write an object, or replace the one with this id. After a kill it is the old one or the new one.

    Parameters
    ----------
    project : Path
    record : ObjectRecord
    membership : array of shape [N], float32
        0 to 1.
    previews : sequence of (str, array)
        File names without suffix, and pictures as `write_png` takes them.
    levels : sequence of arrays of shape [N], float32
        Those of `record.levels`, 0 to 1.
    detailed : Detailed or None
        Stored levels and detailed Gaussians are deleted when none are given.

    Raises
    ------
    DiskError
        When the disk is full or read-only.
    """
    with replace_together(path_within(project, "objects", record.id), optional=COMPUTED_FILES) as new:
        for name, values in ((MEMBERSHIP_FILE, membership), (LEVELS_FILE, levels if record.levels else ())):
            if len(values):
                with atomic_write(new / name) as stream:
                    np.save(stream, np.asarray(values, np.float32), allow_pickle=False)
        if detailed is not None:
            save_detailed(new, detailed)
        for name, picture in previews:
            write_png(new / f"{name}.png", picture)
        files = {name: record_of(new / name) for name in COMPUTED_FILES if (new / name).exists()}
        write_record(new / RECORD_FILE, record, files)


def load_membership(project: Path, object_id: str) -> Float32:
    """Return the membership of an object, shape [N], float32, in [0, 1]."""
    file = _require_intact(project, object_id, MEMBERSHIP_FILE)
    if not file.is_file():
        raise ObjectError(f"{file} is missing. Isolate the object again with `segment`.")
    return read_array(file, ArraySpec("float32", ("n",), finite=True), advice=_ADVICE)


def membership_in(project: Path, record: ObjectRecord, count: int) -> Float32:
    """Return the membership of an object in a scene of `count` Gaussians, float32 [count].

    Raises
    ------
    ObjectError
        When the object belongs to an earlier training of the scene.
    """
    membership = load_membership(project, record.id)
    if len(membership) != count:
        raise ObjectError(f"{record.name!r} was isolated in an earlier training of this scene. Isolate it again.")
    return membership


def load_levels(project: Path, object_id: str) -> Float32:
    """Return the memberships of an object's levels, part first, [K, N], float32; one row when it has no levels."""
    file = _require_intact(project, object_id, LEVELS_FILE)
    if not file.is_file():
        return load_membership(project, object_id)[None]
    return read_array(file, ArraySpec("float32", ("k", "n"), finite=True), advice=_ADVICE)


def object_gaussians(project: Path, record: ObjectRecord, gaussians: Gaussians) -> Gaussians:
    """Return an object for export: its Gaussians among the scene's, detailed where they are.

    Raises
    ------
    ObjectError
        When the object belongs to an earlier training of the scene.
    """
    rows = np.flatnonzero(membership_in(project, record, len(gaussians)) >= record.threshold)
    _require_intact(project, record.id, DETAIL_FILE)
    detailed = load_detailed(project, record.id)
    return gaussians[rows] if detailed is None else detailed.with_detail(gaussians[rows], rows)[0]


def detail_of(detailed: Detailed | None, members: Mask) -> Detailed | None:
    """Return the detail of those that are still members, bool [N]; those that were added stay as in the scene."""
    if detailed is None:
        return None
    kept = members[detailed.rows]
    return detailed.of(kept) if kept.any() else None


def forget_unreadable_record(project: Path, object_id: str) -> None:
    """Delete the record of an object if it is damaged, since no object can be listed then. Its other files stay."""
    try:
        read_record(object_file(project, object_id, RECORD_FILE))
    except FormatError:
        delete_derived(project, "objects", object_id, RECORD_FILE)


def is_object_intact(project: Path, object_id: str) -> bool:
    """Return whether the record of an object can be read, and all files that it records are as they were written."""
    try:
        recorded = recorded_files(object_file(project, object_id, RECORD_FILE))
        for name in recorded:
            _require_intact(project, object_id, name)
        if not recorded:
            for load in (load_levels, load_membership, load_detailed):
                load(project, object_id)
    except HeritageError:
        return False
    return True


def _require_intact(project: Path, object_id: str, name: str) -> Path:
    """Return the path of a file of an object, which is what the object's record says."""
    file = object_file(project, object_id, name)
    record = object_file(project, object_id, RECORD_FILE)
    expected = recorded_files(record).get(name) if record.is_file() else None
    if expected is not None and not is_as_recorded(file, expected):
        problem = "was damaged" if file.exists() else "is missing"
        raise FormatError(f"{file} {problem}. {_ADVICE}")
    return file
