"""Segmentation by a prompt: its evidence is lifted to the Gaussians, and what a text names is ranked."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ..errors import PromptError
from ..events import Emit, Progress, StopCheck, part_of
from ..project_folder import ProjectFolder
from ..rasterizer import PROCESSOR, Device
from ..records import ObjectRecord
from .candidate_file import remember_candidates
from .candidates import THRESHOLD, Candidate, fit_of, overlap
from .context import SegmentationContext, load_context
from .evidence import DetectorFactory, evidence_of_groups, find_evidence, nothing_behind, nothing_found
from .found import FoundObject, ObjectRequest, store_found
from .lifting import Levels, lift, lift_levels
from .paper import find_objects_of_paper
from .photos import SamFactory
from .prompts import Prompt, TextPrompt, describe_prompt
from .ranking import NoMatchError, TextScorer, build_text_candidates, no_match_error, rank_for_text
from .settings import PaperSettings, SegmentSettings
from .spatial import Extent, choose, parse_spatial, showing_camera
from .votes import HALF, MaskEvidence

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = ["THRESHOLD", "find_objects", "isolate_object", "segment_project"]


def find_objects(
    context: SegmentationContext,
    prompt: Prompt,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
) -> list[FoundObject]:
    """Return the objects of a scene that `prompt` asks for, the best first; at least one.

    Parameters
    ----------
    context : SegmentationContext
        Its views and photos are those of `settings.render_side` and `settings.photo_side`.
    prompt : Prompt
    settings : SegmentSettings
    detector_factory : callable
        Called only for a text.
    emit, should_stop
        See `engine.events`.

    Returns
    -------
    list of FoundObject

    Raises
    ------
    PromptError
        When no object was found; `NoMatchError` when every candidate looks too little like a text.
    Cancelled
        When `should_stop` returns True.
    """
    if isinstance(settings, PaperSettings):
        return find_objects_of_paper(
            context, prompt, settings, detector_factory=detector_factory, emit=emit, should_stop=should_stop
        )
    if isinstance(prompt, TextPrompt):
        return _find_text(context, prompt, settings, detector_factory(), emit, should_stop)
    evidence = find_evidence(
        prompt, context, settings, detector_factory=detector_factory, emit=emit, should_stop=should_stop
    )
    found = isolate_object(context, evidence, settings, should_stop)
    emit(Progress("objects", 1.0, message="Isolating"))
    return [found]


def isolate_object(
    context: SegmentationContext, evidence: Sequence[MaskEvidence], settings: SegmentSettings, should_stop: StopCheck
) -> FoundObject:
    """Return the object that all of `evidence` shows.

    Parameters
    ----------
    context : SegmentationContext
    evidence : sequence of MaskEvidence
        At least one mask that is not excluded.
    settings : SegmentSettings
    should_stop : callable

    Raises
    ------
    PromptError
        When no Gaussian lies behind the masks, or the excluded ones leave none.
    Cancelled
        When `should_stop` returns True.
    """
    shown = sorted((item for item in evidence if not item.excluded), key=lambda item: -item.score)
    if shown[0].given:  # a mask drawn by the user is the whole object
        levels = Levels((lift(context, evidence, settings, should_stop=should_stop).membership,))
    else:
        levels = lift_levels(context, evidence, settings, should_stop)
    if not (levels.membership >= HALF).any():
        if any(item.excluded for item in evidence):
            raise PromptError("Nothing is left of the object: the excluded clicks removed all of it. Click elsewhere.")
        raise nothing_behind()
    fit = fit_of(context.views, shown[0].view, shown[0].mask, levels.membership)
    return FoundObject(levels.membership, shown[0].score, fit, tuple(shown), levels)


def _find_text(
    context: SegmentationContext,
    prompt: TextPrompt,
    settings: SegmentSettings,
    detector: Detector,
    emit: Emit,
    should_stop: StopCheck,
) -> list[FoundObject]:
    """Return the objects that a text names, of which its spatial word may choose some; errors as in `find_objects`."""
    spatial = parse_spatial(prompt.text)
    noun = TextPrompt(spatial.noun)
    if not spatial.word:
        return _find_named(context, noun, settings, detector, emit, should_stop)
    found = _find_named(context, noun, settings, detector, part_of(emit, 0, 2), should_stop)
    others: list[FoundObject] = []
    if spatial.other:
        with contextlib.suppress(NoMatchError):  # `choose` says that there is none
            others = _find_named(
                context, TextPrompt(spatial.other), settings, detector, part_of(emit, 1, 2), should_stop
            )
    means = context.views.scene.gaussians.means
    extents, other_extents = ([Extent.of(means[one.membership >= HALF]) for one in kind] for kind in (found, others))
    camera = prompt.camera or showing_camera(context.views.cameras.cameras, extents)
    return [found[number] for number in choose(spatial, extents, other_extents, camera)]


def _find_named(
    context: SegmentationContext,
    prompt: TextPrompt,
    settings: SegmentSettings,
    detector: Detector,
    emit: Emit,
    should_stop: StopCheck,
) -> list[FoundObject]:
    """Return the objects that a text names; errors as in `find_objects`."""
    text = prompt.text
    appearance = None
    if settings.n_groups and detector.check_prompt(text).known:
        appearance = context.group_appearance(detector, emit=part_of(emit, 0, 2), should_stop=should_stop)
        emit = part_of(emit, 1, 2)
    evidence = find_evidence(
        prompt, context, settings, detector_factory=lambda: detector, emit=emit, should_stop=should_stop
    )
    if appearance is not None:
        evidence += evidence_of_groups(text, appearance, context.views, detector, settings.n_groups)
    if not evidence:
        raise nothing_found(text, context, settings)
    candidates = build_text_candidates(context, evidence, settings, should_stop)
    if not candidates:
        raise nothing_behind()
    scorer = TextScorer(text, context, detector, settings, None if appearance is None else appearance.hierarchy)
    ranked = rank_for_text(scorer, candidates, should_stop)
    least = max(settings.least_score, settings.relative_score * ranked[0][0])
    found: list[FoundObject] = []
    for number, (score, candidate) in enumerate(ranked):
        emit(Progress("objects", 0.7 + 0.3 * number / len(ranked), message="Isolating"))
        if score < least or len(found) == settings.max_objects:
            break
        membership = candidate.best.membership
        if not any(overlap(membership, other.membership) > settings.same_object for other in found):
            levels = lift_levels(context, candidate.evidence[:1], settings, should_stop)
            found.append(FoundObject(levels.membership, score, candidate.fit, tuple(candidate.evidence), levels))
    emit(Progress("objects", 1.0, message="Isolating"))
    if not found:
        raise no_match_error(text, _different(ranked, settings), settings)
    return found


def _different(ranked: Sequence[tuple[float, Candidate]], settings: SegmentSettings) -> list[tuple[float, Candidate]]:
    """Return the candidates that are no versions of better ones."""
    kept: list[tuple[float, Candidate]] = []
    for score, candidate in ranked:
        membership = candidate.best.membership
        if not any(overlap(membership, other.best.membership) > settings.same_object for _, other in kept):
            kept.append((score, candidate))
    return kept


def segment_project(
    project: ProjectFolder,
    prompt: Prompt,
    name: str,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    sam_factory: SamFactory,
    emit: Emit,
    should_stop: StopCheck,
    device: Device = PROCESSOR,
) -> list[ObjectRecord]:
    """Isolate the objects that `prompt` asks for in a trained project, and store each of them.

    Parameters
    ----------
    project : ProjectFolder
        A trained project, open for writing.
    prompt : Prompt
    name : str
        Name of the first object; further ones get ``-2``, ``-3``...
    settings : SegmentSettings
    detector_factory, sam_factory : callable
        Called only when their model is needed.
    emit, should_stop
        See `engine.events`.
    device : Device
        See `load_context`.

    Returns
    -------
    list of ObjectRecord
        The new objects, the best first.

    Raises
    ------
    PromptError
        When no object was found. The nearest candidates of a text are then stored (`engine.objects.candidate_file`).
    HeritageError
        When a part of the project is missing or damaged.
    """
    started = time.perf_counter()
    context = load_context(project, settings, sam_factory, device=device, emit=emit)
    request = ObjectRequest(describe_prompt(prompt), name, settings, started)
    return _find_and_store(
        project, context, prompt, request, detector_factory=detector_factory, emit=emit, should_stop=should_stop
    )


def segment_prompt(
    project: ProjectFolder,
    context: SegmentationContext,
    prompt: Prompt,
    name: str,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
    again: tuple[str | None, ...] = (),
) -> list[ObjectRecord]:
    """Do the same as `segment_project` with the `context` of the project, which several prompts share.

    `again` is that of `ObjectRequest`.
    """
    request = ObjectRequest(describe_prompt(prompt), name, settings, time.perf_counter(), again)
    return _find_and_store(
        project, context, prompt, request, detector_factory=detector_factory, emit=emit, should_stop=should_stop
    )


def _find_and_store(
    project: ProjectFolder,
    context: SegmentationContext,
    prompt: Prompt,
    request: ObjectRequest,
    *,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
) -> list[ObjectRecord]:
    try:
        found = find_objects(
            context, prompt, request.settings,
            detector_factory=detector_factory, emit=part_of(emit, 0, 2), should_stop=should_stop,
        )  # fmt: skip
    except PromptError as error:
        if isinstance(prompt, TextPrompt):
            nearest = error.candidates if isinstance(error, NoMatchError) else ()
            remember_candidates(project.path, prompt.text, str(error), nearest, context.photos)
        raise PromptError(str(error)) from error
    if isinstance(prompt, TextPrompt):
        request = replace(request, prompt={**request.prompt, "detector": detector_factory().name})
    return store_found(project, context, found, request, emit=part_of(emit, 1, 2), should_stop=should_stop)
