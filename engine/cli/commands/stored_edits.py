"""Objects edited by hand: memberships that a user gives, new names, deletions. What is replaced goes to the trash."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ...core.arrays import Float32
from ...core.errors import ObjectError
from ...core.files import ArraySpec, read_array
from ...objects.settings import DEFAULT_THRESHOLD
from ...project.folder import ProjectFolder
from ...project.objects import (
    ObjectRecord,
    delete_object,
    detail_of,
    keep_version,
    list_objects,
    load_levels,
    load_membership,
    load_object,
    new_id,
    object_ids,
    rename_object,
    save_object,
    taken_ids,
)
from ...scene import load_detailed

BY_HAND = "hand"
"""Kind of prompt of an object that was made by hand."""


_ADVICE = "Write it again as a NumPy array of float32, one value for each Gaussian of the scene."


def read_membership(file: Path) -> Float32:
    """Return the membership in a ``.npy`` file, shape [N]; raises `FormatError` when it cannot be read."""
    return read_array(file, ArraySpec("float32", ("n",), finite=True), advice=_ADVICE)


def store_edits(
    project: ProjectFolder,
    memberships: Mapping[str, Float32],
    *,
    names: Mapping[str, str],
    deleted: Sequence[str],
    thresholds: Mapping[str, float] | None = None,
    levels: Mapping[str, int] | None = None,
) -> list[ObjectRecord]:
    """Store edits by hand and return the objects that were set or renamed. All is checked before anything is changed.

    Parameters
    ----------
    project : ProjectFolder
        A trained project, open for writing.
    memberships : mapping of str to array of shape [N], float32
        By id of the object: the new membership of each Gaussian of the scene, in [0, 1]. An id that no object has
        makes a new object.
    names : mapping of str to str
        New names by id.
    deleted : sequence of str
        Ids of objects that go to the trash.
    thresholds : mapping of str to float
        By id: the smallest membership, in [0, 1], of a Gaussian that belongs to the object.
    levels : mapping of str to int
        By id: the level that becomes the object, of those with a level other than the present one.

    Raises
    ------
    ObjectError
        When an id cannot be used, a membership does not fit the scene, an object has no such level, or it would be
        empty.
    """
    from ...training import load_gaussians

    project.require_intact("training")
    count = len(load_gaussians(project.path / "gaussians"))
    known = object_ids(project.path)
    thresholds, levels = thresholds or {}, levels or {}
    for object_id, membership in memberships.items():
        _check(object_id, membership, count, thresholds.get(object_id, DEFAULT_THRESHOLD))
        if object_id not in known and new_id(object_id, taken_ids(project.path)) != object_id:
            raise ObjectError(f"A new object cannot have the id {object_id!r}. Use lower case letters, digits and -.")
    for object_id in (*names, *deleted, *thresholds, *levels):
        if object_id not in known and object_id not in memberships:
            raise ObjectError(f"{project.path} has no object with the id {object_id!r}.")
    shown = {
        object_id: _shown(project, object_id, thresholds.get(object_id), levels.get(object_id))
        for object_id in dict.fromkeys((*thresholds, *levels))
        if object_id not in memberships and object_id not in deleted
    }
    for object_id in deleted:
        delete_object(project, object_id, why="deleted by hand")
    for object_id, (record, membership) in shown.items():
        _replace(project, record, membership, why="shown otherwise", levels=list(load_levels(project.path, object_id)))
    for object_id, membership in memberships.items():
        if object_id in known and object_id not in deleted:
            _change(project, load_object(project.path, object_id), membership, thresholds.get(object_id))
        else:
            save_object(
                project.path, _new(object_id, membership, thresholds.get(object_id, DEFAULT_THRESHOLD)), membership
            )
    for object_id, name in names.items():
        rename_object(project.path, object_id, name)
    changed = {*memberships, *names, *shown}
    return [record for record in list_objects(project.path) if record.id in changed]


def _shown(
    project: ProjectFolder, object_id: str, threshold: float | None, level: int | None
) -> tuple[ObjectRecord, Float32]:
    """Return an object's record and membership at another threshold or level."""
    record = load_object(project.path, object_id)
    threshold = record.threshold if threshold is None else threshold
    if not 0.0 <= threshold <= 1.0:
        raise ObjectError(f"The threshold of {record.name!r} must be from 0 to 1, got {threshold:g}.")
    membership = load_membership(project.path, object_id)
    if level is not None and level != record.level:
        levels = load_levels(project.path, object_id)
        if not record.levels or not 0 <= level < len(levels):
            raise ObjectError(f"{record.name!r} has no level {level}.")
        membership = levels[level]
    n_gaussians = int((membership >= np.float32(threshold)).sum())
    if not n_gaussians:
        raise ObjectError(f"Nothing would be left of {record.name!r}. Lower its threshold, or delete it.")
    level = record.level if level is None else level
    return replace(record, threshold=threshold, level=level, n_gaussians=n_gaussians), membership


def _check(object_id: str, membership: Float32, count: int, threshold: float) -> None:
    if len(membership) != count:
        raise ObjectError(
            f"The membership of {object_id!r} has {len(membership)} values, but the scene has {count} Gaussians."
        )
    if len(membership) and not (membership.min() >= 0 and membership.max() <= 1):
        raise ObjectError(f"The membership of {object_id!r} must be from 0 to 1.")
    if not 0.0 <= threshold <= 1.0:
        raise ObjectError(f"The threshold of {object_id!r} must be from 0 to 1, got {threshold:g}.")
    if not (membership >= np.float32(threshold)).any():
        raise ObjectError(f"Nothing would be left of {object_id!r}. Delete it instead.")


def _change(project: ProjectFolder, record: ObjectRecord, membership: Float32, threshold: float | None) -> None:
    threshold = record.threshold if threshold is None else threshold
    changed = replace(
        record,
        threshold=threshold,
        n_gaussians=int((membership >= np.float32(threshold)).sum()),
        n_scene_gaussians=len(membership),
        level=0,
        levels=(),
        refined=(*record.refined, {"clicks": [], "not": [], "by": BY_HAND}),
    )
    _replace(project, changed, membership, why="edited by hand")


def _replace(
    project: ProjectFolder, record: ObjectRecord, membership: Float32, *, why: str, levels: Sequence[Float32] = ()
) -> None:
    """Store an object in place of the present one, a copy of which goes to the trash."""
    members = membership >= np.float32(record.threshold)
    detailed = detail_of(load_detailed(project.path, record.id), members)
    keep_version(project, record.id, why=why)
    record = replace(record, detail=None if detailed is None else record.detail)
    save_object(project.path, record, membership, levels=levels, detailed=detailed)


def _new(object_id: str, membership: Float32, threshold: float) -> ObjectRecord:
    return ObjectRecord(
        id=object_id,
        name=object_id,
        prompt={"kind": BY_HAND},
        threshold=threshold,
        score=1.0,
        fit=1.0,
        n_gaussians=int((membership >= np.float32(threshold)).sum()),
        n_scene_gaussians=len(membership),
        created=datetime.now(UTC).isoformat(timespec="microseconds"),
    )
