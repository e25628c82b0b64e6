"""Segmentation by a prompt: mask evidence is lifted to the Gaussians, ranked, refined, completed and stored."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import PromptError
from ..events import Emit, Progress, StopCheck, part_of
from ..project_folder import ProjectFolder
from ..rasterizer import PROCESSOR, Device
from ..records import ObjectRecord
from .candidate_file import remember_candidates
from .candidates import THRESHOLD, Candidate, build_candidates, fit_of, overlap
from .context import SegmentationContext, load_context
from .correction import find_excluded_gaussians, remove_gaussians
from .evidence import DetectorFactory, MaskEvidence, evidence_of_groups, find_evidence
from .found import FoundObject, ObjectRequest, store_found
from .hierarchy import Hierarchy
from .levels import Levels, find_levels
from .lifting import complete, refine_by_votes
from .photos import SamFactory
from .prompts import BoxPrompt, ClickPrompt, MaskPrompt, Prompt, TextPrompt, describe_prompt
from .ranking import NoMatchError, TextScorer, build_text_candidates, no_match_error, rank_for_text
from .settings import SegmentSettings

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = [
    "THRESHOLD",
    "find_objects",
    "isolate_objects",
    "refine_membership",
    "segment_project",
    "segment_prompt",
]

MAX_REFUSED = 2  # chosen on museum_room, store_room
"""Candidates of a text that are completed by votes and levels, and still score too low, before the search ends."""

MIN_SCORE_RETENTION = 0.8  # chosen on museum_room, store_room
"""Smallest similarity of a candidate to the text after the votes, relative to its similarity before.

Below it the membership before the votes is kept: the votes have spoiled the candidate, for example thin parts that SAM
outlines together with what is behind them.
"""

Float32 = NDArray[np.float32]


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
        When no object was found.
    Cancelled
        When `should_stop` returns True.

    References
    ----------
    Dahaghin et al., "Gaussian Heritage" (2024): feature of the best-fitting mask over sampled views, cosine 0.7,
    convex hull.
    """
    appearance = None
    by_groups = settings.n_groups > 0 and settings.n_rescored > 0
    if isinstance(prompt, TextPrompt) and by_groups and detector_factory().check_prompt(prompt.text).known:
        appearance = context.group_appearance(detector_factory(), emit=part_of(emit, 0, 2), should_stop=should_stop)
        emit = part_of(emit, 1, 2)
    evidence = find_evidence(
        prompt, context, settings, detector_factory=detector_factory, emit=emit, should_stop=should_stop
    )
    if isinstance(prompt, TextPrompt):
        if appearance is not None:
            evidence += evidence_of_groups(
                prompt.text, appearance, context.views, detector_factory(), settings.n_groups
            )
        if not evidence:
            n_photos = min(settings.n_text_views, len(context.label_maps) or len(context.views.cameras.cameras))
            raise PromptError(
                f"{prompt.text!r} was not found in {n_photos} photos. Use another word, or click on the object instead."
            )
    return isolate_objects(
        context, prompt, evidence, settings, detector_factory=detector_factory, emit=emit, should_stop=should_stop
    )


def isolate_objects(
    context: SegmentationContext,
    prompt: Prompt,
    evidence: Sequence[MaskEvidence],
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
    accepted: bool = False,
) -> list[FoundObject]:
    """Return the objects that mask evidence shows, the best first; at least one.

    Parameters
    ----------
    context : SegmentationContext
    prompt : Prompt
        The origin of `evidence`. All evidence of clicks shows one object, that of a text may show several.
    evidence : sequence of MaskEvidence
    settings : SegmentSettings
    detector_factory : callable
        Called only for a text.
    emit, should_stop
        See `engine.events`.
    accepted : bool
        The user confirmed that the evidence shows the object: the text is then not refused for a low score.

    Raises
    ------
    PromptError
        When no object was found; `NoMatchError` when every candidate looks too little like the text.
    Cancelled
        When `should_stop` returns True.
    """
    if isinstance(prompt, TextPrompt):
        text, detector = prompt.text, detector_factory()
        return _isolate_named(context, text, evidence, settings, detector, emit, should_stop, accepted=accepted)
    candidates = build_candidates(context.views, evidence, settings, should_stop)
    _require_candidates(candidates)
    scored = [(candidate.evidence[0].score, candidate) for candidate in candidates]
    memberships = [refine_membership(context, candidate, settings, should_stop) for candidate in candidates]
    if isinstance(prompt, ClickPrompt) and len(scored) > 1:
        # Clicks in several photos show one object, even where no mask shows all of it.
        scored = [(max(score for score, _ in scored), _merge_candidates(scored))]
        memberships = [np.maximum.reduce(memberships)]
    found: list[FoundObject] = []
    for number, ((score, candidate), membership) in enumerate(zip(scored, memberships, strict=True)):
        if prompt.excluded:
            membership = _remove_excluded(context, prompt, membership, settings, should_stop)
        if not any(overlap(membership, other.membership) > settings.same_object for other in found):
            # A mask drawn by the user is the whole object.
            given = candidate.evidence[0].given
            levels = (
                Levels((membership,)) if given else _find_levels(context, candidate, membership, settings, should_stop)
            )
            found.append(_found_object(context, candidate, levels, score))
        emit(Progress("objects", 0.7 + 0.3 * (number + 1) / len(scored), message="Isolating"))
    return found


def _merge_candidates(scored: Sequence[tuple[float, Candidate]]) -> Candidate:
    """Return the candidate with the best score, with the evidence of all of them."""
    best = max(scored, key=lambda pair: pair[0])[1]
    evidence = [item for _, candidate in scored for item in candidate.evidence]
    return Candidate(best.best, [*best.evidence, *(item for item in evidence if item not in best.evidence)], best.fit)


def _isolate_named(
    context: SegmentationContext,
    text: str,
    evidence: Sequence[MaskEvidence],
    settings: SegmentSettings,
    detector: Detector,
    emit: Emit,
    should_stop: StopCheck,
    *,
    accepted: bool,
) -> list[FoundObject]:
    """Return the objects that `text` names among those that the evidence shows; errors as in `isolate_objects`."""
    by_appearance = settings.n_rescored > 0 and not accepted
    build = build_text_candidates if by_appearance else build_candidates
    candidates = build(context.views, evidence, settings, should_stop)
    _require_candidates(candidates)
    ranked = [(candidate.evidence[0].score, candidate) for candidate in candidates]
    hierarchy = None
    if by_appearance and settings.n_groups:
        appearance = context.group_appearance(detector, emit=emit, should_stop=should_stop)
        hierarchy = None if appearance is None else appearance.hierarchy
    scorer = TextScorer(text, context, detector, settings, hierarchy)
    if not accepted:
        ranked = rank_for_text(scorer, candidates, should_stop)
    found: list[FoundObject] = []
    refused: list[tuple[float, Candidate]] = []
    for number, (score, candidate) in enumerate(ranked):
        emit(Progress("objects", 0.7 + 0.3 * number / len(ranked), message="Isolating"))
        if len(found) == settings.max_objects or (found and score < settings.relative_score * ranked[0][0]):
            break
        if not found and len(refused) == MAX_REFUSED:
            break
        if _is_found(candidate.best.membership, found, settings):
            continue
        membership = refine_membership(context, candidate, settings, should_stop)
        if by_appearance and scorer.similarity(membership >= THRESHOLD) < MIN_SCORE_RETENTION * scorer.similarity(
            candidate.best.members
        ):
            membership = candidate.best.membership
        if _is_found(membership, found, settings):
            continue
        levels = _find_levels(context, candidate, membership, settings, should_stop, scorer.similarity, hierarchy)
        if by_appearance:
            # A level may be less prominent because its base is like the support. That makes the match no less certain.
            score = max(scorer.score(candidate, level >= THRESHOLD) for level in (membership, levels.membership))
        if by_appearance and score < settings.least_score:
            refused.append((score, candidate))
        else:
            found.append(_found_object(context, candidate, levels, score))
    emit(Progress("objects", 1.0, message="Isolating"))
    if not found:
        raise no_match_error(text, _nearest(refused, ranked, settings), settings)
    best = max(item.score for item in found)
    kept = [item for item in found if item.score >= settings.relative_score * best or not by_appearance]
    return sorted(kept, key=lambda item: -item.score)


def _is_found(membership: Float32, found: Sequence[FoundObject], settings: SegmentSettings) -> bool:
    return any(overlap(membership, other.membership) > settings.same_object for other in found)


def _nearest(
    refused: Sequence[tuple[float, Candidate]], ranked: Sequence[tuple[float, Candidate]], settings: SegmentSettings
) -> list[tuple[float, Candidate]]:
    """Return the refused candidates, the best first, and then those of the others that are no versions of them."""
    nearest = sorted(refused, key=lambda pair: -pair[0])
    for score, candidate in ranked:
        membership = candidate.best.membership
        if not any(overlap(membership, other.best.membership) > settings.same_object for _, other in nearest):
            nearest.append((score, candidate))
    return nearest


def _require_candidates(candidates: Sequence[Candidate]) -> None:
    if not candidates:
        raise PromptError(
            "No Gaussian of the scene lies behind what was found in the photos. Choose another photo or prompt."
        )


def _found_object(context: SegmentationContext, candidate: Candidate, levels: Levels, score: float) -> FoundObject:
    best = candidate.evidence[0]
    fit = fit_of(context.views, best.view, best.mask, levels.membership)
    return FoundObject(levels.membership, score, fit, tuple(candidate.evidence), levels)


def _remove_excluded(
    context: SegmentationContext,
    prompt: ClickPrompt | BoxPrompt | MaskPrompt,
    membership: Float32,
    settings: SegmentSettings,
    should_stop: StopCheck,
) -> Float32:
    """Return the membership without what the excluded clicks of the prompt remove."""
    clicks = prompt.clicks if isinstance(prompt, ClickPrompt) else ()
    removed = find_excluded_gaussians(prompt.excluded, clicks, membership >= THRESHOLD, context, settings, should_stop)
    corrected = remove_gaussians(membership, removed)
    if not (corrected >= THRESHOLD).any():
        raise PromptError("Nothing is left of the object: the excluded clicks removed all of it. Click elsewhere.")
    return corrected


def _find_levels(
    context: SegmentationContext,
    candidate: Candidate,
    membership: Float32,
    settings: SegmentSettings,
    should_stop: StopCheck,
    scorer: Callable[[NDArray[np.bool_]], float] | None = None,
    hierarchy: Hierarchy | None = None,
) -> Levels:
    if settings.n_level_views == 0:
        return Levels((membership,))
    return find_levels(
        context,
        membership,
        candidate.best.directions,
        settings,
        scorer=scorer,
        hierarchy=hierarchy,
        should_stop=should_stop,
    )


def refine_membership(
    context: SegmentationContext, candidate: Candidate, settings: SegmentSettings, should_stop: StopCheck
) -> Float32:
    """Return the membership of a candidate after votes and completion, shape [N], float32."""
    lifted = candidate.best
    if settings.refinement == "votes":
        best = candidate.evidence[0]
        given = (best.view, best.mask) if best.given else None
        lifted = refine_by_votes(context.views, lifted, given, context.label_maps, settings, should_stop=should_stop)
    return complete(context.views, lifted, settings)


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
