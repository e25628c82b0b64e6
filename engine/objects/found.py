"""What a prompt found: an object before it has a name, and how it gets one and is stored."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..events import Emit, StopCheck
from ..project_folder import ProjectFolder
from ..settings import to_dict
from .candidates import THRESHOLD
from .context import SegmentationContext
from .evidence import Seed
from .growing import Levels
from .polishing import polish_each
from .settings import SegmentSettings
from .storage import ObjectRecord, list_objects, new_id, new_name, save_object

__all__ = ["FoundObject", "record_of", "store_found"]

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class FoundObject:
    """An object before it has a name.

    Attributes
    ----------
    membership : array of shape [N], float32
        In [0, 1]; `THRESHOLD` and above belongs.
    score : float
        See `ObjectRecord.score`.
    fit : float
        Intersection over union with the best seed mask in its view.
    seeds : tuple of Seed
        Masks that show it, the best first.
    levels : Levels
        Smaller and larger versions; the chosen one is `membership`.
    """

    membership: Float32
    score: float
    fit: float
    seeds: tuple[Seed, ...]
    levels: Levels


def store_found(
    project: ProjectFolder,
    trained: SegmentationContext,
    found: Sequence[FoundObject],
    asked: dict[str, Any],
    name: str,
    settings: SegmentSettings,
    started: float,
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> list[ObjectRecord]:
    """Polish objects, store them under names of their own and return their records.

    Parameters
    ----------
    project : ProjectFolder
    trained : SegmentationContext
        Of this project.
    found : sequence of FoundObject
    asked : dict
        The prompt as `describe_prompt` gives it.
    name : str
    settings : SegmentSettings
    started : float
        `time.perf_counter` of the prompt.
    emit, should_stop
        See `engine.events`.

    Raises
    ------
    Cancelled
        When `should_stop` says so; nothing is stored then.
    """
    members = [item.membership >= THRESHOLD for item in found]
    # All of them first: a prompt that is stopped half-way is asked again, and must not leave half of what it found.
    each = polish_each(trained.views, members, settings, emit=emit, should_stop=should_stop)
    records: list[ObjectRecord] = []
    for item, polished in zip(found, each, strict=True):
        record = record_of(
            project.path,
            item.levels,
            asked,
            name,
            settings,
            started,
            score=item.score,
            fit=item.fit,
            seeds=tuple({"photo": seed.view.camera.photo, "score": round(seed.score, 4)} for seed in item.seeds),
        )
        best = item.seeds[0]
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


def record_of(
    project: Path,
    levels: Levels,
    asked: dict[str, Any],
    name: str,
    settings: SegmentSettings,
    started: float,
    *,
    score: float,
    fit: float,
    seeds: tuple[dict[str, Any], ...] = (),
) -> ObjectRecord:
    """Return the record of a new object, with an id and a name that are free in `project`."""
    taken = list_objects(project)
    several = len(levels.memberships) > 1
    counts = [int((one >= THRESHOLD).sum()) for one in levels.memberships]
    return ObjectRecord(
        id=new_id(name, [other.id for other in taken]),
        name=new_name(name, [other.name for other in taken]),
        prompt=asked,
        threshold=THRESHOLD,
        score=round(score, 4),
        fit=round(fit, 4),
        n_gaussians=counts[levels.chosen],
        n_scene_gaussians=len(levels.membership),
        seeds=seeds,
        settings=to_dict(settings),
        seconds=round(time.perf_counter() - started, 3),
        created=datetime.now(UTC).isoformat(timespec="microseconds"),
        level=levels.chosen if several else 0,
        levels=tuple({"n_gaussians": count} for count in counts) if several else (),
    )
