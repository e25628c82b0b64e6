"""Objects found by a prompt, before they have a name, and how they are named and stored."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import PromptError
from ..events import Emit, StopCheck
from ..masks import mask_iou
from ..project_folder import ProjectFolder
from ..provenance import describe_run
from ..records import ObjectRecord, new_id, new_name
from ..settings import to_dict
from .context import SegmentationContext
from .lifting import Levels
from .polishing import polish_each
from .settings import SegmentSettings
from .storage import list_objects, save_object, taken_ids
from .views import View, Views
from .votes import THRESHOLD, MaskEvidence

__all__ = ["FoundObject", "NoMatchError", "ObjectRequest", "fit_of", "new_record", "overlap", "store_found"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class FoundObject:
    """An object before it has a name.

    Attributes
    ----------
    membership : array of shape [N], float32
        In [0, 1]; a Gaussian belongs from `THRESHOLD` on.
    score : float
        See `ObjectRecord.score`.
    fit : float
        IoU with the best mask of `evidence` in its view.
    evidence : tuple of MaskEvidence
        Masks that show the object, the best first.
    levels : Levels
        Smaller and larger versions; the chosen one is `membership`.
    """

    membership: Float32
    score: float
    fit: float
    evidence: tuple[MaskEvidence, ...]
    levels: Levels


class NoMatchError(PromptError):
    """Nothing in the scene looks enough like the text.

    Attributes
    ----------
    candidates : tuple of FoundObject
        What looks most like it, the best first.
    """

    def __init__(self, message: str, candidates: Sequence[FoundObject]) -> None:
        super().__init__(message)
        self.candidates = tuple(candidates)


def fit_of(views: Views, view: View, mask: Mask, membership: Float32) -> float:
    """Return the IoU of a mask with the object rendered in the same view."""
    return mask_iou(views.visible_share(view, membership >= THRESHOLD) > THRESHOLD, mask)


def overlap(first: Float32, second: Float32) -> float:
    """Return the number of common Gaussians of two memberships [N] as a share of the smaller object."""
    a, b = first >= THRESHOLD, second >= THRESHOLD
    smaller = min(int(a.sum()), int(b.sum()))
    return int((a & b).sum()) / smaller if smaller else 0.0


@dataclass(frozen=True)
class ObjectRequest:
    """What was asked for, as the records of all resulting objects state it.

    Attributes
    ----------
    prompt : dict
        The prompt as `describe_prompt` returns it.
    name : str
        Wanted name of the objects.
    settings : SegmentSettings
    started : float
        `time.perf_counter` at the start.
    again : tuple of (str or None)
        Ids of the objects that an earlier run stored for this prompt, in their order, when only some are made again:
        each keeps its id and name. None stands for one that is not stored. By default all are stored as new objects.
    """

    prompt: dict[str, Any]
    name: str
    settings: SegmentSettings
    started: float
    again: tuple[str | None, ...] = ()


def store_found(
    project: ProjectFolder,
    context: SegmentationContext,
    found: Sequence[FoundObject],
    request: ObjectRequest,
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> list[ObjectRecord]:
    """Polish objects, store each under a name of its own and return their records.

    Parameters
    ----------
    project : ProjectFolder
    context : SegmentationContext
        Of this project.
    found : sequence of FoundObject
    request : ObjectRequest
    emit, should_stop
        See `engine.events`.

    Raises
    ------
    Cancelled
        When `should_stop` returns True; nothing is stored then.
    """
    ids: Sequence[str | None] = [None] * len(found)
    if request.again:
        pairs = [(item, known) for item, known in zip(found, request.again, strict=False) if known is not None]
        found, ids = [item for item, _ in pairs], [known for _, known in pairs]
    names = {record.id: record.name for record in list_objects(project.path)}
    members = [item.membership >= THRESHOLD for item in found]
    # All objects are polished before the first is stored, so that a cancelled prompt stores none and can be repeated.
    all_polished = polish_each(context.views, members, request.settings, emit=emit, should_stop=should_stop)
    records: list[ObjectRecord] = []
    for item, known, polished in zip(found, ids, all_polished, strict=True):
        record = new_record(project.path, item.levels, request, score=item.score, fit=item.fit, evidence=item.evidence)
        if known is not None:
            record = replace(record, id=known, name=names.get(known, record.name))
        best = item.evidence[0]
        preview = np.where(best.view.to_photo(best.mask), np.uint8(255), np.uint8(0))
        save_object(
            project.path,
            record,
            item.membership,
            [("seed", preview)],
            levels=item.levels.memberships,
            polished=polished,
        )
        records.append(record)
    return records


def new_record(
    project: Path,
    levels: Levels,
    request: ObjectRequest,
    *,
    score: float,
    fit: float,
    evidence: Sequence[MaskEvidence] = (),
) -> ObjectRecord:
    """Return the record of a new object, with an id and a name that no other object of `project` has."""
    existing = list_objects(project)
    several = len(levels.memberships) > 1
    counts = [int((level >= THRESHOLD).sum()) for level in levels.memberships]
    return ObjectRecord(
        id=new_id(request.name, taken_ids(project)),
        name=new_name(request.name, [record.name for record in existing]),
        prompt=request.prompt,
        threshold=THRESHOLD,
        score=round(score, 4),
        fit=round(fit, 4),
        n_gaussians=counts[levels.chosen],
        n_scene_gaussians=len(levels.membership),
        evidence=tuple({"photo": item.view.camera.photo, "score": round(item.score, 4)} for item in evidence),
        settings=to_dict(request.settings),
        seconds=round(time.perf_counter() - request.started, 3),
        created=datetime.now(UTC).isoformat(timespec="microseconds"),
        level=levels.chosen if several else 0,
        levels=tuple({"n_gaussians": count} for count in counts) if several else (),
        run=describe_run(),
    )
