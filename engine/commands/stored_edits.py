"""Objects edited by hand: memberships that a user gives, new names, deletions. What is replaced goes to the trash."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from ..errors import ObjectError
from ..objects import (
    THRESHOLD,
    delete_object,
    keep_version,
    list_objects,
    load_object,
    object_ids,
    save_object,
    taken_ids,
)
from ..project_folder import ProjectFolder
from ..records import ObjectRecord, new_id, rename_object
from ..scene import Polished, load_polished

__all__ = ["BY_HAND", "store_edits"]

BY_HAND = "hand"
"""Kind of prompt of an object that was made by hand."""

Float32 = NDArray[np.float32]


def store_edits(
    project: ProjectFolder,
    memberships: Mapping[str, Float32],
    *,
    names: Mapping[str, str],
    deleted: Sequence[str],
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

    Raises
    ------
    ObjectError
        When an id cannot be used, a membership does not fit the scene, or an object would be empty.
    """
    from ..gaussians import load_gaussians

    project.require_intact("training")
    count = len(load_gaussians(project.path / "gaussians"))
    known = object_ids(project.path)
    for object_id, membership in memberships.items():
        _check(object_id, membership, count)
        if object_id not in known and new_id(object_id, taken_ids(project.path)) != object_id:
            raise ObjectError(f"A new object cannot have the id {object_id!r}. Use lower case letters, digits and -.")
    for object_id in (*names, *deleted):
        if object_id not in known and object_id not in memberships:
            raise ObjectError(f"{project.path} has no object with the id {object_id!r}.")
    for object_id in deleted:
        delete_object(project, object_id, why="deleted by hand")
    for object_id, membership in memberships.items():
        if object_id in known and object_id not in deleted:
            _change(project, load_object(project.path, object_id), membership)
        else:
            save_object(project.path, _new(object_id, membership), membership)
    for object_id, name in names.items():
        rename_object(project.path, object_id, name)
    changed = {*memberships, *names}
    return [record for record in list_objects(project.path) if record.id in changed]


def _check(object_id: str, membership: Float32, count: int) -> None:
    if len(membership) != count:
        raise ObjectError(
            f"The membership of {object_id!r} has {len(membership)} values, but the scene has {count} Gaussians."
        )
    if len(membership) and not (membership.min() >= 0 and membership.max() <= 1):
        raise ObjectError(f"The membership of {object_id!r} must be from 0 to 1.")
    if not (membership >= THRESHOLD).any():
        raise ObjectError(f"Nothing would be left of {object_id!r}. Delete it instead.")


def _change(project: ProjectFolder, record: ObjectRecord, membership: Float32) -> None:
    members = membership >= record.threshold
    changed = replace(
        record,
        n_gaussians=int(members.sum()),
        n_scene_gaussians=len(membership),
        level=0,
        levels=(),
        refined=(*record.refined, {"clicks": [], "not": [], "by": BY_HAND}),
    )
    polished = load_polished(project.path, record.id)
    keep_version(project, record.id, why="edited by hand")
    save_object(project.path, changed, membership, polished=None if polished is None else _those_of(polished, members))


def _those_of(polished: Polished, members: NDArray[np.bool_]) -> Polished | None:
    """Return the polished Gaussians of those that are still members; those that were added have trained values."""
    kept = members[polished.rows]
    if not kept.any():
        return None
    return Polished(polished.rows[kept], polished.trained_means[kept], polished.gaussians[kept])


def _new(object_id: str, membership: Float32) -> ObjectRecord:
    return ObjectRecord(
        id=object_id,
        name=object_id,
        prompt={"kind": BY_HAND},
        threshold=THRESHOLD,
        score=1.0,
        fit=1.0,
        n_gaussians=int((membership >= THRESHOLD).sum()),
        n_scene_gaussians=len(membership),
        created=datetime.now(UTC).isoformat(timespec="microseconds"),
    )
