"""Stored objects get detail from the photos: one after the other, or each on a computer of its own where some help."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arrays import Float32, Mask
from ..core.errors import ObjectError
from ..core.events import ignore_events, never_stop
from ..core.files import delete_derived, read_json, write_json
from ..core.settings import to_dict
from ..core.shares import Need, helper_places, run_shares, taken_items
from ..core.system import usable_cores
from ..project.folder import ProjectFolder
from ..project.objects import (
    ObjectRecord,
    keep_version,
    list_objects,
    load_levels,
    load_membership,
    load_object,
    membership_in,
    save_object,
)
from ..rasterizer import PROCESSOR
from ..scene import load_detailed, read_detailed, save_detailed
from .context import SegmentationContext, scene_on
from .detail import DetailResult, detail_object
from .detail_cutter import DetailPhotos
from .known_objects import BACKGROUND
from .settings import SegmentSettings
from .views import Views

_MEMORY = 2_000_000_000
"""Memory of a share on a helper."""
_FOLDER, _RECORD = "detail_shares", "record.json"
"""Folder in the project for what helpers make, which is gone afterwards, and the file there that is written last."""


def detail_objects(project: ProjectFolder, context: SegmentationContext, names: Sequence[str]) -> list[ObjectRecord]:
    """Give stored objects detail, and return their records; see `Segmenter.detail`."""
    path, n_scene = project.path, len(context.means)
    records = [load_object(path, name) for name in names] or [
        one for one in list_objects(path) if one.prompt.get("kind") != BACKGROUND
    ]
    if not records:
        raise ObjectError("This scene has no objects yet. Isolate one first.")
    for record in records:
        if record.prompt.get("kind") == BACKGROUND:
            raise ObjectError(f"{record.name!r} is the background, which has no detail. Name an object.")
        membership_in(path, record, n_scene)
    detailed: dict[str, ObjectRecord] = {}

    def keep(record: ObjectRecord, made: DetailResult | None = None) -> None:
        levels = list(load_levels(path, record.id)) if record.levels else []
        step = context.part(len(detailed), len(records))
        membership = load_membership(path, record.id)
        detailed[record.id] = keep_with_detail(project, step, record, membership, levels, "detailed", made=made)

    missing = {
        one.id: one for one in records if _detail_of(path, one, load_membership(path, one.id) >= one.threshold) is None
    }
    need = Need(cores=len(usable_cores()), memory=_MEMORY)
    if context.views.scene.backend == "cpu" and len(missing) > 1 and helper_places(need):
        _make_with_helpers(path, list(missing), need, context, lambda one, made: keep(missing[one], made))
    for record in records:
        if record.id not in detailed:
            keep(record)
    return [detailed[record.id] for record in records]


def _make_with_helpers(
    project: Path, ids: list[str], need: Need, context: SegmentationContext, keep: Callable[[str, DetailResult], None]
) -> None:
    """Detail objects here and on helpers, each by one process, and hand over each result when it is there."""
    folder = project / _FOLDER
    delete_derived(project, folder.name)
    kept: set[str] = set()

    def take() -> None:
        for object_id in [one for one in ids if one not in kept]:
            if (record_file := folder / object_id / _RECORD).is_file():
                record = read_json(record_file, {"kept": bool}, advice="Detail the object again.")
                kept.add(object_id)
                keep(object_id, DetailResult(read_detailed(record_file.parent) if record["kept"] else None, record))

    arguments = {
        "project": str(project), "ids": ids, "settings": to_dict(context.settings), "folder": str(folder),
    }  # fmt: skip
    try:
        run_shares(
            "objects.detailing:detail_share", arguments, len(ids), need,
            folder=folder, what="detailing", processes=1, watch=take, should_stop=context.should_stop,
        )  # fmt: skip
    finally:
        delete_derived(project, folder.name)


def _detail_of(project: Path, record: ObjectRecord, members: Mask) -> DetailResult | None:
    """Return the detail of an object that has that of its present Gaussians, bool [N]; else None."""
    known = load_detailed(project, record.id)
    if known is None or not np.array_equal(known.rows, np.flatnonzero(members)):
        return None
    return DetailResult(known, dict(record.detail or {}))


def keep_with_detail(
    project: ProjectFolder,
    context: SegmentationContext,
    record: ObjectRecord,
    membership: Float32,
    levels: list[Float32],
    why: str,
    *,
    made: DetailResult | None = None,
) -> ObjectRecord:
    """Store an object with detail from the photos, which is `made` or made now.

    The old one is copied to the trash, whose list says `why`; an object that has just this stays.
    """
    members, path = membership >= record.threshold, project.path
    known = _detail_of(path, record, members)
    if known is not None and record == load_object(path, record.id):
        return record
    result = known or made
    if result is None:
        message = f"Detailing {record.name}"
        context.tell(0.0, message)
        result = detail_object(
            context.views, DetailPhotos.of(project), members, context.settings, should_stop=context.should_stop,
            tell=lambda done, left: context.tell(done, message, left),
        )  # fmt: skip
    if known is None:
        context.tell(1.0, f"{record.name}: {result.sentence}")
    keep_version(project, record.id, why=why)
    changed = replace(record, n_gaussians=int(members.sum()), detail=result.record)
    save_object(path, changed, membership, levels=levels, detailed=result.detailed)
    return changed


def detail_share(project: str, ids: list[str], settings: dict[str, Any], folder: str) -> None:
    """Detail objects that no other process has taken, in a child process that only reads the project.

    Parameters
    ----------
    project : str
    ids : list of str
        Of the objects.
    settings : dict
        `SegmentSettings`.
    folder : str
        Gets a folder for each object, with its figures and, if they are kept, its Gaussians.

    Raises
    ------
    HeritageError
        When a part of the project is missing or damaged, or a photo cannot be read.
    """
    from ..scene import read_camera_set
    from ..training import load_gaussians

    opened, chosen, shares = ProjectFolder.open_existing(Path(project)), SegmentSettings(**settings), Path(folder)
    scene = scene_on(PROCESSOR, load_gaussians(opened.path / "gaussians"), ignore_events)
    views = Views(scene, read_camera_set(opened.path / "cameras"), render_side=chosen.render_side)
    for number in taken_items(shares, len(ids)):
        record = load_object(opened.path, ids[number])
        members = load_membership(opened.path, record.id) >= record.threshold
        result = detail_object(views, DetailPhotos.of(opened), members, chosen, should_stop=never_stop)
        if result.detailed is not None:
            save_detailed(shares / record.id, result.detailed)
        write_json(shares / record.id / _RECORD, result.record)
