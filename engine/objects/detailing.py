"""Stored objects get detail from the photos: one after the other, or each on a computer of its own where some help."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arrays import Float32, Mask
from ..core.errors import ObjectError
from ..core.events import ignore_events, never_stop
from ..core.files import delete_derived
from ..core.settings import to_dict
from ..core.shares import Arguments, Need, divided, run_shares
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
from .detail import DetailPhotos, DetailResult, detail_object
from .known_objects import BACKGROUND
from .settings import SegmentSettings
from .views import Views

_MEMORY = 2_000_000_000
"""Memory of a share on a helper."""
_FOLDER = "detail_shares"
"""Folder in the project for what helpers make; there is none afterwards."""


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

    missing = [one for one in records if _detail_of(path, one, load_membership(path, one.id) >= one.threshold) is None]
    need = Need(cores=len(usable_cores()), memory=_MEMORY)
    if context.views.scene.backend == "cpu" and len(divided(missing, 1, need, least=1)) > 1:
        shares = [_arguments(path, one, context.settings) for one in missing]

        def take(number: int, record: dict[str, Any]) -> None:
            folder = Path(shares[number]["folder"])
            keep(missing[number], DetailResult(read_detailed(folder) if record["kept"] else None, record))

        try:
            run_shares(
                "objects.detailing:detail_share", [functools.partial(dict, share) for share in shares], need,
                what="detailing", processes=1, finished=take, should_stop=context.should_stop,
            )  # fmt: skip
        finally:
            delete_derived(path, _FOLDER)
    for record in records:
        if record.id not in detailed:
            keep(record)
    return [detailed[record.id] for record in records]


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


def _arguments(project: Path, record: ObjectRecord, settings: SegmentSettings) -> Arguments:
    folder = project / _FOLDER / record.id
    return {"project": str(project), "name": record.id, "settings": to_dict(settings), "folder": str(folder)}


def detail_share(project: str, name: str, settings: dict[str, Any], folder: str) -> dict[str, Any]:
    """Detail an object in a child process, write its Gaussians to `folder` if they are kept, and return its figures.

    Parameters
    ----------
    project : str
        Only read.
    name : str
        Id of the object.
    settings : dict
        `SegmentSettings`.
    folder : str

    Raises
    ------
    HeritageError
        When a part of the project is missing or damaged, or a photo cannot be read.
    """
    from ..scene import read_camera_set
    from ..training import load_gaussians

    opened, chosen = ProjectFolder.open_existing(Path(project)), SegmentSettings(**settings)
    record = load_object(opened.path, name)
    scene = scene_on(PROCESSOR, load_gaussians(opened.path / "gaussians"), ignore_events)
    views = Views(scene, read_camera_set(opened.path / "cameras"), render_side=chosen.render_side)
    members = load_membership(opened.path, record.id) >= record.threshold
    result = detail_object(views, DetailPhotos.of(opened), members, chosen, should_stop=never_stop)
    if result.detailed is not None:
        save_detailed(Path(folder), result.detailed)
    return result.record
