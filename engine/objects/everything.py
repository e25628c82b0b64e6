"""Segmentation of all objects of a scene without a prompt, with names suggested by the detector."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import PromptError
from ..events import Emit, Progress, StopCheck, part_of
from ..project_folder import ProjectFolder
from ..rasterizer import PROCESSOR, Device
from ..records import ObjectRecord
from .context import SegmentationContext, load_context
from .curation import memberships_of, store_background
from .evidence import DetectorFactory
from .found import ObjectRequest, new_record, overlap
from .graph import bounded
from .lifting import Levels
from .photos import SamFactory
from .polishing import polish_each
from .proposals import LEAST_PROBABILITY, apart
from .settings import SegmentSettings
from .storage import save_object
from .votes import THRESHOLD, votes_of_known

__all__ = ["DetectedObject", "find_everything", "segment_everything_in"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_MIN_NAME_SCORE = 0.17  # chosen on museum_room
"""Score of the detector from which on a name is suggested."""


@dataclass(frozen=True)
class DetectedObject:
    """An object found without a prompt.

    Attributes
    ----------
    membership : array of shape [N], float32
        In [0, 1].
    name : str
        Name suggested by the detector; empty below `_MIN_NAME_SCORE`.
    score : float
        Score of the detector, 0 to 1.
    """

    membership: Float32
    name: str
    score: float

    @property
    def members(self) -> Mask:
        """Gaussians that belong to the object, bool [N]."""
        return self.membership >= THRESHOLD


def find_everything(
    context: SegmentationContext,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
) -> list[DetectedObject]:
    """Return the objects of a scene without its background, in descending order of score; no two overlap.

    Parameters
    ----------
    context : SegmentationContext
    settings : SegmentSettings
    detector_factory : callable
    emit, should_stop
        See `engine.events`.

    Returns
    -------
    list of DetectedObject

    Raises
    ------
    Cancelled
        When `should_stop` returns True.

    Notes
    -----
    Of the proposals (`engine.objects.proposals`), those are chosen that do not overlap and have the largest sum of
    probabilities of being an object, each less the least one.
    """
    views, graph, detector = context.views, context.graph(settings, should_stop), detector_factory()
    looks = context.looks(detector, settings, emit=emit, should_stop=should_stop)
    chosen = apart(looks.members, looks.probability - LEAST_PROBABILITY)
    members = looks.members[chosen].T
    solved = graph.solve_each(votes_of_known(members, graph.pixels[:, None]), settings.strictness).T
    names = looks.names(detector, chosen)
    objects: list[DetectedObject] = []
    taken = np.zeros(len(views.scene), bool)
    # What stands on something larger keeps its Gaussians.
    for k in np.argsort(members.sum(axis=0), kind="stable"):
        membership = bounded(np.where(taken, np.float32(0), solved[k]), views.scene.gaussians.means)
        taken |= membership >= THRESHOLD
        name, score = names[k]
        if (membership >= THRESHOLD).any():
            objects.append(DetectedObject(membership, name if score >= _MIN_NAME_SCORE else "", score))
    return sorted(objects, key=lambda item: -item.score)


def segment_everything_in(
    project: ProjectFolder,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    sam_factory: SamFactory,
    emit: Emit,
    should_stop: StopCheck,
    device: Device = PROCESSOR,
) -> tuple[list[ObjectRecord], list[str], ObjectRecord]:
    """Store every object of a trained project that is not stored yet, and the background.

    Parameters
    ----------
    project : ProjectFolder
        A trained project, open for writing.
    settings, detector_factory, sam_factory, emit, should_stop, device
        As in `engine.objects.segment.segment_project`.

    Returns
    -------
    list of ObjectRecord
        The new objects, in descending order of score.
    list of str
        Ids of existing objects that were found again. They stay unchanged.
    ObjectRecord
        The background.

    Raises
    ------
    PromptError
        If the scene contains nothing but background.
    HeritageError
        If a part of the project is missing or damaged.
    """
    started = time.perf_counter()
    context = load_context(project, settings, sam_factory, device=device, emit=emit)
    found = find_everything(
        context, settings, detector_factory=detector_factory, emit=part_of(emit, 0, 2), should_stop=should_stop
    )
    existing = memberships_of(project.path, len(context.views.scene))
    if not found and not existing:
        raise PromptError("No object was found in front of the background of this scene. Click on an object instead.")
    same = [
        [key for key, other in existing.items() if overlap(item.membership, other) > settings.same_object]
        for item in found
    ]
    new = [(number, item) for number, (item, keys) in enumerate(zip(found, same, strict=True), 1) if not keys]
    each = polish_each(
        context.views, [item.members for _, item in new], settings, emit=part_of(emit, 1, 2), should_stop=should_stop
    )
    records: list[ObjectRecord] = []
    for (number, item), polished in zip(new, each, strict=True):
        record = new_record(
            project.path,
            Levels((item.membership,)),
            ObjectRequest({"kind": "all"}, item.name or f"object {number}", settings, started),
            score=item.score if item.name else 0.0,
            fit=1.0,
        )
        save_object(project.path, record, item.membership, polished=polished)
        records.append(record)
    background = store_background(project, settings)
    emit(Progress("objects", 1.0, message="Isolating"))
    return records, list(dict.fromkeys(key for keys in same for key in keys)), background
