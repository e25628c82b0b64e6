"""Operations on a trained project: segment texts, accept a candidate, correct an object, store the background."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import ObjectError, PromptError
from ..events import Emit, StopCheck, Warned, part_of
from ..project_folder import ProjectFolder
from ..rasterizer import PROCESSOR, Device
from ..records import ObjectRecord
from ..scene import Camera, PinholeCamera
from .candidate_file import forget_candidates, load_candidate
from .context import SegmentationContext, load_context
from .evidence import DetectorFactory, evidence_of_clicks, evidence_of_exclusions
from .found import ObjectRequest, new_record, store_found
from .lifting import Levels, lift
from .photos import SamFactory
from .polishing import polish_each
from .prompts import MaskPrompt, Point, TextPrompt, camera_of_prompt, describe_points, describe_prompt, load_mask
from .segment import isolate_object, segment_prompt
from .settings import SegmentSettings
from .storage import (
    list_objects,
    load_fitting_membership,
    load_levels,
    load_membership,
    load_object,
    save_object,
)
from .trash import delete_object, keep_version
from .votes import BELOW_HALF, THRESHOLD, MaskEvidence

__all__ = [
    "BACKGROUND",
    "TextResult",
    "accept_candidate",
    "choose_level",
    "memberships_of",
    "refine_object",
    "segment_each_text",
    "segment_texts",
    "store_background",
]

BACKGROUND = "background"
"""Prompt kind, name and id of the background."""

Float32 = NDArray[np.float32]

_MIN_REMAINING_SHARE = 0.05  # chosen on museum_room
"""Smallest share of an object's Gaussians that a correction may leave. Less than that are fragments."""


@dataclass(frozen=True)
class TextResult:
    """Objects found for one text, or the reason why there are none.

    Attributes
    ----------
    text : str
    records : tuple of ObjectRecord
        The stored objects, the best first; empty for a refused text.
    refusal : str
        Why the text was refused; empty if objects were found.
    """

    text: str
    records: tuple[ObjectRecord, ...] = ()
    refusal: str = ""


def segment_each_text(
    project: ProjectFolder,
    context: SegmentationContext,
    names: Mapping[str, str],
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
    skip: Collection[str] = (),
    again: Mapping[str, Sequence[str | None]] | None = None,
    camera: Camera | PinholeCamera | None = None,
) -> Iterator[TextResult]:
    """Segment the objects of each text, and yield its result as soon as the objects are stored.

    A refused text does not end the others. Reporting it is left to the caller.

    Parameters
    ----------
    project : ProjectFolder
        A trained project, open for writing.
    context : SegmentationContext
        Context of this project.
    names : mapping of str to str
        Name of the objects by text.
    settings, detector_factory, emit, should_stop
        As in `engine.objects.segment.segment_project`.
    skip : collection of str
        Texts that were segmented before, e.g. in a run that was killed. They yield nothing.
    again : mapping of str to sequence of (str or None), optional
        By text: ids of its objects that are made again, see `engine.objects.found.ObjectRequest`.
    camera : Camera or PinholeCamera, optional
        Where the user looks from, for left and right.

    Yields
    ------
    TextResult

    Raises
    ------
    HeritageError
        If a part of the project is missing or damaged.
    """
    for number, (text, name) in enumerate(names.items()):
        if text in skip:
            continue
        try:
            records = segment_prompt(
                project,
                context,
                TextPrompt(text, camera),
                name,
                settings,
                detector_factory=detector_factory,
                emit=part_of(emit, number, len(names)),
                should_stop=should_stop,
                again=tuple((again or {}).get(text, ())),
            )
        except PromptError as error:
            yield TextResult(text, refusal=str(error))
        else:
            yield TextResult(text, tuple(records))


def segment_texts(
    project: ProjectFolder,
    texts: Sequence[str],
    name: str | None,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    sam_factory: SamFactory,
    emit: Emit,
    should_stop: StopCheck,
    device: Device = PROCESSOR,
    camera: Camera | PinholeCamera | None = None,
) -> tuple[list[ObjectRecord], dict[str, str]]:
    """Segment the objects of several texts and store them.

    Parameters
    ----------
    project : ProjectFolder
        A trained project, open for writing.
    texts : sequence of str
    name : str or None
        Name of the objects; by default each is named after its text.
    settings, detector_factory, sam_factory, emit, should_stop, device
        As in `engine.objects.segment.segment_project`.
    camera : Camera or PinholeCamera, optional
        As in `segment_each_text`.

    Returns
    -------
    list of ObjectRecord
        The stored objects.
    dict of str to str
        Refused texts with the reason, which is also emitted as a warning. The candidates for them are in
        `engine.objects.candidate_file.CANDIDATES`.

    Raises
    ------
    PromptError
        If every text is refused.
    HeritageError
        If a part of the project is missing or damaged.
    """
    forget_candidates(project.path)
    results = list(
        segment_each_text(
            project,
            load_context(project, settings, sam_factory, device=device, emit=emit),
            {text: name or text for text in texts},
            settings,
            detector_factory=detector_factory,
            emit=emit,
            should_stop=should_stop,
            camera=camera,
        )
    )
    records = [record for result in results for record in result.records]
    refused = {result.text: result.refusal for result in results if result.refusal}
    if not records:
        raise PromptError(" ".join(refused.values()))
    for message in refused.values():
        emit(Warned(message))
    return records, refused


def accept_candidate(
    project: ProjectFolder,
    number: int,
    name: str | None,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    sam_factory: SamFactory,
    emit: Emit,
    should_stop: StopCheck,
    device: Device = PROCESSOR,
) -> list[ObjectRecord]:
    """Segment a candidate of a refused text that the user accepted.

    Parameters
    ----------
    project : ProjectFolder
        A trained project, open for writing.
    number : int
        Number of the candidate in `engine.objects.candidate_file.CANDIDATES`.
    name : str or None
        Name of the object; by default the text.
    settings, detector_factory, sam_factory, emit, should_stop, device
        As in `engine.objects.segment.segment_project`.

    Returns
    -------
    list of ObjectRecord

    Raises
    ------
    PromptError
        If there is no such candidate.
    HeritageError
        If a part of the project is missing or damaged.
    """
    started = time.perf_counter()
    candidate = load_candidate(project.path, number)
    context = load_context(project, settings, sam_factory, device=device, emit=emit)
    camera = camera_of_prompt(MaskPrompt(candidate.photo, candidate.mask), context.views.cameras)
    view = context.views.of(camera)
    evidence = MaskEvidence(view, view.from_photo(load_mask(candidate.mask, camera)), candidate.score)
    prompt = TextPrompt(candidate.text)
    found = [isolate_object(context, [evidence], settings, should_stop)]
    description = {**describe_prompt(prompt), "detector": detector_factory().name, "accepted": True}
    request = ObjectRequest(description, name or candidate.text, settings, started)
    return store_found(project, context, found, request, emit=part_of(emit, 1, 2), should_stop=should_stop)


def refine_object(
    project: ProjectFolder,
    name: str,
    clicks: Sequence[Point],
    excluded: Sequence[Point],
    settings: SegmentSettings,
    *,
    sam_factory: SamFactory,
    emit: Emit,
    should_stop: StopCheck,
    device: Device = PROCESSOR,
) -> ObjectRecord:
    """Correct a stored object by clicks.

    Parameters
    ----------
    project : ProjectFolder
        A trained project, open for writing.
    name : str
        Name or id of the object.
    clicks, excluded : sequence of Point
        Clicks on what to add, and on what to remove. At least one in total.
    settings, sam_factory, emit, should_stop, device
        As in `engine.objects.segment.segment_project`.

    Returns
    -------
    ObjectRecord
        With the same id and name. The levels are removed, because they were versions of the old object, which is copied
        to the trash.

    Raises
    ------
    ObjectError
        If there is no such object, or it belongs to an earlier training.
    PromptError
        If a click hits no Gaussian, or nothing of the object would remain.
    """
    record = load_object(project.path, name)
    context = load_context(project, settings, sam_factory, device=device, emit=emit)
    membership = load_fitting_membership(project.path, record, len(context.views.scene))
    before = int((membership >= record.threshold).sum())
    views = context.views
    evidence = evidence_of_exclusions(excluded, clicks, context) + evidence_of_clicks(clicks, context)
    membership = lift(context, evidence, settings, before=membership, should_stop=should_stop)
    if (membership >= record.threshold).sum() < max(1.0, _MIN_REMAINING_SHARE * before):
        raise PromptError(f"Nothing would be left of {record.name!r}, so it was not changed. Click elsewhere.")
    correction = {"clicks": describe_points(clicks), "not": describe_points(excluded)}
    changed = replace(
        record,
        n_gaussians=int((membership >= record.threshold).sum()),
        level=0,
        levels=(),
        refined=(*record.refined, correction),
    )
    (polished,) = polish_each(views, [membership >= record.threshold], settings, emit=emit, should_stop=should_stop)
    keep_version(project, record.id, why="corrected")
    save_object(project.path, changed, membership, polished=polished)
    return changed


def choose_level(
    project: ProjectFolder,
    name: str,
    level: int,
    settings: SegmentSettings,
    *,
    sam_factory: SamFactory,
    emit: Emit,
    should_stop: StopCheck,
    device: Device = PROCESSOR,
) -> ObjectRecord:
    """Replace a stored object by another one of its levels.

    Parameters
    ----------
    project : ProjectFolder
        A trained project, open for writing.
    name : str
        Name or id of the object.
    level : int
        Index of the level; 0 is the smallest part.
    settings, sam_factory, emit, should_stop, device
        As in `engine.objects.segment.segment_project`. SAM is not called.

    Returns
    -------
    ObjectRecord

    Raises
    ------
    ObjectError
        If there is no such object or level, or it belongs to an earlier training.
    """
    record = load_object(project.path, name)
    levels = load_levels(project.path, record.id)
    if not 0 <= level < len(levels):
        available = "only one level" if len(levels) == 1 else f"levels 0 to {len(levels) - 1}"
        raise ObjectError(f"{record.name!r} has {available}, and no level {level}.")
    if not record.levels:
        return record
    changed = replace(record, level=level, n_gaussians=int((levels[level] >= record.threshold).sum()))
    views = load_context(project, settings, sam_factory, device=device, emit=emit).views
    load_fitting_membership(project.path, record, len(views.scene))
    (polished,) = polish_each(views, [levels[level] >= record.threshold], settings, emit=emit, should_stop=should_stop)
    save_object(project.path, changed, levels[level], levels=list(levels), polished=polished)
    return changed


def memberships_of(project: Path, count: int) -> dict[str, Float32]:
    """Return the memberships of all objects of a scene with `count` Gaussians by id, without the background."""
    memberships = {}
    for record in list_objects(project):
        if record.prompt.get("kind") != BACKGROUND and record.n_scene_gaussians == count:
            memberships[record.id] = load_membership(project, record.id)
    return memberships


def store_background(project: ProjectFolder, settings: SegmentSettings) -> ObjectRecord:
    """Store the Gaussians that belong to no object as an object of its own; an earlier background goes to the trash.

    Parameters
    ----------
    project : ProjectFolder
        A trained project, open for writing.
    settings : SegmentSettings
        Stored in the record.

    Returns
    -------
    ObjectRecord

    Raises
    ------
    ObjectError
        If the scene has no objects.
    """
    from ..gaussians import load_gaussians

    started = time.perf_counter()
    project.require_intact("training")
    count = len(load_gaussians(project.path / "gaussians"))
    memberships = memberships_of(project.path, count)
    if not memberships:
        raise ObjectError(
            "This scene has no objects yet, so everything would be background. Isolate one, or use --all."
        )
    highest = np.maximum.reduce(list(memberships.values()))
    # 1 - m. At exactly 0.5 a Gaussian belongs to the object only, never to both.
    background = np.where(highest >= THRESHOLD, np.minimum(1 - highest, BELOW_HALF), 1 - highest)
    for record in list_objects(project.path):
        if record.prompt.get("kind") == BACKGROUND:
            delete_object(project, record.id, why="replaced by a new background")
    membership = background.astype(np.float32)
    request = ObjectRequest({"kind": BACKGROUND}, BACKGROUND, settings, started)
    background_record = new_record(project.path, Levels((membership,)), request, score=1.0, fit=1.0)
    save_object(project.path, background_record, membership)
    return background_record
