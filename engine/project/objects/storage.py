"""Objects on disk: ``objects/<id>/`` with the record, the membership, levels, detailed Gaussians and previews.

The record holds size and SHA-256 of the computed files, which are checked when they are read; pictures, and the museum
record that the user writes, are not among them. Functions that read an object raise `ObjectError` when there is none,
and `FormatError` when a file is damaged, or its folder is a link that leads out of the project.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ...core.arrays import Float32, Mask
from ...core.errors import FormatError, HeritageError, ObjectError
from ...core.files import (
    ArraySpec,
    atomic_write,
    delete_derived,
    is_as_recorded,
    object_file,
    path_within,
    read_array,
    record_of,
    replace_together,
    write_file,
)
from ...scene import Detailed, Gaussians, load_detailed, save_detailed
from .object_record import (
    COMPUTED_FILES,
    DETAIL_FILE,
    LEVELS_FILE,
    MEMBERSHIP_FILE,
    RECORD_FILE,
    ObjectRecord,
    read_record,
    recorded_files,
    write_record,
)

_ADVICE = "Isolate the object again."


def save_object(
    project: Path,
    record: ObjectRecord,
    membership: Float32,
    *,
    levels: Sequence[Float32] = (),
    detailed: Detailed | None = None,
    pictures: Mapping[str, bytes] | None = None,
) -> None:
    """Write an object, or replace the one with this id. After a kill it is the old one or the new one.

    Parameters
    ----------
    membership : array of shape [N], float32
        0 to 1.
    levels : sequence of arrays of shape [N], float32
        Those of `record.levels`, 0 to 1.
    detailed : Detailed or None
        Stored levels and detailed Gaussians are deleted when none are given.
    pictures : mapping of str to bytes, optional
        Files of pictures by name.

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
        for name, picture in (pictures or {}).items():
            write_file(new / name, picture)
        files = {name: record_of(new / name) for name in COMPUTED_FILES if (new / name).exists()}
        write_record(new / RECORD_FILE, record, files)


def load_membership(project: Path, object_id: str, count: int | None = None) -> Float32:
    """Return the membership of an object, shape [N], float32, in [0, 1].

    Parameters
    ----------
    count : int, optional
        Gaussians of the scene that it is for: that of another scene is refused with `FormatError`.
    """
    require_intact(project, object_id, MEMBERSHIP_FILE)
    file = object_file(project, object_id, MEMBERSHIP_FILE)
    if not file.is_file():
        raise ObjectError(f"{file} is missing. Isolate the object again with `segment`.")
    membership = read_array(file, ArraySpec("float32", ("n",), finite=True), advice=_ADVICE)
    _require_count(project, object_id, len(membership), count)
    return membership


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
    require_intact(project, object_id, LEVELS_FILE)
    file = object_file(project, object_id, LEVELS_FILE)
    if not file.is_file():
        return load_membership(project, object_id)[None]
    return read_array(file, ArraySpec("float32", ("k", "n"), finite=True), advice=_ADVICE)


def load_level(project: Path, object_id: str, level: int, count: int) -> Float32:
    """Return the membership of an object at one of its levels, float32 [count], without reading or hashing the others.

    Raises
    ------
    FormatError
        When the file cannot be read, belongs to another scene, or has no such level.
    """
    file = object_file(project, object_id, LEVELS_FILE)
    # Memory-mapped: the slider needs only one of several levels.
    levels = read_array(file, ArraySpec("float32", ("k", "n")), advice=_ADVICE, mapped=True)
    _require_count(project, object_id, levels.shape[1], count)
    if not 0 <= level < len(levels):
        raise FormatError(
            f"The object {object_id} of {project} has only {len(levels)} levels now; level {level + 1} is missing. "
            "Open the project again."
        )
    membership = np.array(levels[level])
    if not np.isfinite(membership).all():
        raise FormatError(f"{file} cannot be read: it has values that are not finite. {_ADVICE}")
    return membership


def _require_count(project: Path, object_id: str, found: int, count: int | None) -> None:
    if count is not None and found != count:
        raise FormatError(
            f"The object {object_id} of {project} belongs to another version of the scene ({found} Gaussians, not "
            f"{count}). Isolate it again."
        )


def object_gaussians(project: Path, record: ObjectRecord, gaussians: Gaussians) -> Gaussians:
    """Return an object for export: its Gaussians among the scene's, detailed where they are.

    Raises
    ------
    ObjectError
        When the object belongs to an earlier training of the scene.
    """
    rows = np.flatnonzero(membership_in(project, record, len(gaussians)) >= record.threshold)
    require_intact(project, record.id, DETAIL_FILE)
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
        require_intact(project, object_id)
        if not recorded_files(object_file(project, object_id, RECORD_FILE)):
            for load in (load_levels, load_membership, load_detailed):
                load(project, object_id)
    except HeritageError:
        return False
    return True


def require_intact(project: Path, object_id: str, *names: str) -> None:
    """Check files of an object against the sizes and hashes in its record; by default, all that it records.

    Raises
    ------
    FormatError
        When one of them is missing or damaged.
    """
    record = object_file(project, object_id, RECORD_FILE)
    recorded = recorded_files(record) if record.is_file() or not names else {}
    for name in names or recorded:
        file = object_file(project, object_id, name)
        if name in recorded and not is_as_recorded(file, recorded[name]):
            raise FormatError(f"{file} {'was damaged' if file.exists() else 'is missing'}. {_ADVICE}")
