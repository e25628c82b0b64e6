"""What a curator does with a trained project: ask for several things, correct an object, accept a candidate."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import ObjectError, PromptError
from ..events import Emit, StopCheck, Warned, part_of
from ..project_folder import ProjectFolder
from .candidate_file import forget_candidates, load_candidate
from .candidates import THRESHOLD, gather
from .context import SegmentationContext, load_context
from .correction import taken_away, without
from .evidence import DetectorFactory, Seed, evidence_of_clicks
from .found import record_of, store_found
from .growing import Levels
from .photos import SamFactory
from .polishing import polish_each
from .prompts import MaskPrompt, Point, TextPrompt, camera_of_prompt, describe_points, describe_prompt, load_mask
from .segment import finish, isolate, segment_project
from .settings import SegmentSettings
from .storage import (
    ObjectRecord,
    delete_object,
    list_objects,
    load_fitting_membership,
    load_levels,
    load_membership,
    load_object,
    save_object,
)

__all__ = [
    "BACKGROUND",
    "accept_candidate",
    "choose_level",
    "memberships_of",
    "refine_object",
    "segment_texts",
    "store_background",
]

BACKGROUND = "background"

Float32 = NDArray[np.float32]

_LEAST_LEFT = 0.05
"""Of an object's Gaussians after a correction: less are crumbs."""


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
) -> tuple[list[ObjectRecord], dict[str, str]]:
    """Isolate what each text names and store it.

    Parameters
    ----------
    project : ProjectFolder
        SegmentationContext, and held for writing.
    texts : sequence of str
    name : str or None
        Of the objects; each text itself by default.
    settings, detector_factory, sam_factory, emit, should_stop
        As in `engine.objects.segment.segment_project`.

    Returns
    -------
    list of ObjectRecord
        Those stored now.
    dict of str to str
        The refused texts, each with the sentence that says why; a warning each. What came nearest to them is in
        `engine.objects.candidate_file.CANDIDATES`.

    Raises
    ------
    PromptError
        When every text is refused.
    HeritageError
        When a part of the project is missing or damaged.
    """
    forget_candidates(project.path)
    trained = load_context(project, settings, sam_factory)
    records: list[ObjectRecord] = []
    refused: dict[str, str] = {}
    for number, text in enumerate(texts):
        try:
            records += segment_project(
                project,
                TextPrompt(text),
                name or text,
                settings,
                detector_factory=detector_factory,
                sam_factory=sam_factory,
                emit=part_of(emit, number, len(texts)),
                should_stop=should_stop,
                trained=trained,
            )
        except PromptError as error:
            # One text that finds nothing must not cost the person the others.
            refused[text] = str(error)
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
) -> list[ObjectRecord]:
    """Isolate a candidate of a refused text, because the person says that it is what was meant.

    Parameters
    ----------
    project : ProjectFolder
    number : int
        Of the candidate in `engine.objects.candidate_file.CANDIDATES`.
    name : str or None
        Of the object; the text by default.
    settings, detector_factory, sam_factory, emit, should_stop
        As in `engine.objects.segment.segment_project`.

    Raises
    ------
    PromptError
        When there is no such candidate.
    HeritageError
        When a part of the project is missing or damaged.
    """
    started = time.perf_counter()
    kept = load_candidate(project.path, number)
    trained = load_context(project, settings, sam_factory)
    camera = camera_of_prompt(MaskPrompt(kept.photo, kept.mask), trained.views.cameras)
    view = trained.views.of(camera)
    seed = Seed(view, view.from_photo(load_mask(kept.mask, camera)), kept.score)
    prompt = TextPrompt(kept.text)
    found = isolate(
        trained,
        prompt,
        [seed],
        settings,
        detector_factory=detector_factory,
        emit=part_of(emit, 0, 2),
        should_stop=should_stop,
        accepted=True,
    )
    asked = {**describe_prompt(prompt), "detector": detector_factory().name, "accepted": True}
    return store_found(
        project, trained, found, asked, name or kept.text, settings, started,
        emit=part_of(emit, 1, 2), should_stop=should_stop,
    )  # fmt: skip


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
) -> ObjectRecord:
    """Correct a stored object: what `clicks` hit joins it, what `excluded` hit leaves it, the rest stays as it is.

    Parameters
    ----------
    project : ProjectFolder
        Held for writing.
    name : str
        Name or id of the object.
    clicks, excluded : sequence of Point
        At least one together.
    settings, sam_factory, emit, should_stop
        As in `engine.objects.segment.segment_project`.

    Returns
    -------
    ObjectRecord
        The same id and name. Its levels are gone: they were versions of what it was.

    Raises
    ------
    ObjectError
        When there is no such object, or it belongs to an earlier training.
    PromptError
        For a click where nothing is, and when nothing of the object would be left.
    """
    record = load_object(project.path, name)
    trained = load_context(project, settings, sam_factory)
    membership = load_fitting_membership(project.path, record, len(trained.views.scene))
    before = int((membership >= record.threshold).sum())
    views = trained.views
    if clicks:
        for candidate in gather(views, _seeds(clicks, excluded, trained, settings), settings, should_stop):
            membership = np.maximum(membership, finish(trained, candidate, settings, should_stop))
    if excluded:
        away = taken_away(
            excluded,
            clicks,
            membership >= THRESHOLD,
            views,
            trained.photos,
            trained.label_maps,
            settings,
            should_stop,
        )
        membership = without(membership, away)
    if (membership >= record.threshold).sum() < max(1.0, _LEAST_LEFT * before):
        raise PromptError(f"Nothing would be left of {record.name!r}; it stays as it was. Click elsewhere.")
    refined = {"clicks": describe_points(clicks), "not": describe_points(excluded)}
    changed = replace(
        record,
        n_gaussians=int((membership >= record.threshold).sum()),
        level=0,
        levels=(),
        refined=(*record.refined, refined),
    )
    (polished,) = polish_each(views, [membership >= record.threshold], settings, emit=emit, should_stop=should_stop)
    save_object(project.path, changed, membership, polished=polished)
    return changed


def _seeds(
    clicks: Sequence[Point], excluded: Sequence[Point], trained: SegmentationContext, settings: SegmentSettings
) -> list[Seed]:
    return evidence_of_clicks(clicks, excluded, trained.views, trained.photos, settings)


def choose_level(
    project: ProjectFolder,
    name: str,
    level: int,
    settings: SegmentSettings,
    *,
    sam_factory: SamFactory,
    emit: Emit,
    should_stop: StopCheck,
) -> ObjectRecord:
    """Make another of an object's levels the object; 0 is its smallest part.

    Parameters
    ----------
    project : ProjectFolder
        Held for writing.
    name : str
        Name or id of the object.
    level : int
    settings, sam_factory, emit, should_stop
        As in `engine.objects.segment.segment_project`; SAM is not called.

    Raises
    ------
    ObjectError
        When there is no such object or level, or it belongs to an earlier training.
    """
    record = load_object(project.path, name)
    levels = load_levels(project.path, record.id)
    if not 0 <= level < len(levels):
        only = "only one level" if len(levels) == 1 else f"levels 0 to {len(levels) - 1}"
        raise ObjectError(f"{record.name!r} has {only}, and no level {level}.")
    if not record.levels:
        return record
    changed = replace(record, level=level, n_gaussians=int((levels[level] >= record.threshold).sum()))
    views = load_context(project, settings, sam_factory).views
    load_fitting_membership(project.path, record, len(views.scene))
    (polished,) = polish_each(views, [levels[level] >= record.threshold], settings, emit=emit, should_stop=should_stop)
    save_object(project.path, changed, levels[level], levels=list(levels), polished=polished)
    return changed


def memberships_of(project: Path, count: int) -> dict[str, Float32]:
    """Return the memberships of all objects but the background that belong to a scene of `count` Gaussians, by id."""
    found = {}
    for record in list_objects(project):
        if record.prompt.get("kind") != BACKGROUND and record.n_scene_gaussians == count:
            found[record.id] = load_membership(project, record.id)
    return found


def store_background(project: ProjectFolder, settings: SegmentSettings) -> ObjectRecord:
    """Store what belongs to no object as an object of its own; an earlier background is replaced.

    Raises
    ------
    ObjectError
        When there is no object that it could be the complement of.
    """
    from ..gaussians import load_gaussians

    started = time.perf_counter()
    count = len(load_gaussians(project.path / "gaussians"))
    memberships = memberships_of(project.path, count)
    if not memberships:
        raise ObjectError(
            "This scene has no objects yet, so everything would be background. Isolate one, or use --all."
        )
    highest = np.maximum.reduce(list(memberships.values()))
    half = np.float32(THRESHOLD)
    # 1 - m, with exactly one half on the objects' side: a Gaussian belongs to an object or to the background.
    background = np.where(highest >= half, np.minimum(1 - highest, np.nextafter(half, np.float32(0))), 1 - highest)
    for record in list_objects(project.path):
        if record.prompt.get("kind") == BACKGROUND:
            delete_object(project.path, record.id)
    membership = background.astype(np.float32)
    made = record_of(
        project.path, Levels((membership,)), {"kind": BACKGROUND}, BACKGROUND, settings, started, score=1.0, fit=1.0
    )
    save_object(project.path, made, membership)
    return made
