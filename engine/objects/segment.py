"""A prompt becomes objects: seeds in photos, lifted to the Gaussians, told apart, refined, completed and stored."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import PromptError
from ..events import Emit, Progress, StopCheck, part_of
from ..pictures import Backend, Scene
from ..project_folder import ProjectFolder
from ..scene import CameraSet, Gaussians
from .candidate_file import remember_candidates
from .candidates import THRESHOLD, Candidate, fit_of, gather, overlap
from .context import SegmentationContext, load_context
from .correction import taken_away, without
from .evidence import DetectorFactory, Seed, find_evidence
from .found import FoundObject, store_found
from .growing import Levels, levels_of
from .hierarchy import Hierarchy
from .lifting import complete, refine_by_votes
from .looks import evidence_of_groups
from .photos import Photos, SamFactory
from .prompts import BoxPrompt, ClickPrompt, MaskPrompt, Prompt, TextPrompt, describe_prompt
from .ranking import NothingAlike, TextJudge, gather_for_text, nothing_alike, rank_for_text
from .settings import SegmentSettings
from .storage import ObjectRecord
from .views import Views

if TYPE_CHECKING:
    from ..grounding import Detector
    from ..masks import EmbeddingFolder

__all__ = [
    "THRESHOLD",
    "find_objects",
    "finish",
    "isolate",
    "segment_project",
]

_TRIES = 2
"""Finds of a text that votes and levels are spent on before it is told as not found."""

_WORSE = 0.8
"""Of a text, votes that leave a find looking less than this part as much like the text have spoiled it: thin parts that
SAM draws together with what is behind them. It then stays as it was found."""

Float32 = NDArray[np.float32]


def find_objects(
    gaussians: Gaussians,
    cameras: CameraSet,
    photo_folder: Path,
    prompt: Prompt,
    settings: SegmentSettings,
    *,
    label_maps: Mapping[str, NDArray[np.int32]],
    detector_factory: DetectorFactory,
    sam_factory: SamFactory,
    emit: Emit,
    should_stop: StopCheck,
    backend: Backend = "cpu",
    embeddings: EmbeddingFolder | None = None,
    looks_file: Path | None = None,
) -> list[FoundObject]:
    """Return the objects of a scene that `prompt` asks for, the best first; at least one.

    Parameters
    ----------
    gaussians : Gaussians
        With features.
    cameras : CameraSet
    photo_folder : Path
    prompt : Prompt
    settings : SegmentSettings
    label_maps : mapping of str to int32 array of shape [h, w]
        SAM label maps by photo, for a text and for the votes; may be empty.
    detector_factory, sam_factory : callable
        Called only when their model is needed.
    emit, should_stop
        See `engine.events`.
    backend : {"cpu", "reference"}
    embeddings : EmbeddingFolder, optional
        Where SAM's embeddings of the photos are kept.
    looks_file : Path, optional
        Where what the scene's groups look like is kept.

    Returns
    -------
    list of FoundObject

    Raises
    ------
    PromptError
        When nothing was found.
    ObjectError
        When the scene has no features.
    Cancelled
        When `should_stop` says so.

    References
    ----------
    Dahaghin et al., "Gaussian Heritage" (2024): feature of the best-fitting mask over sampled views, cosine 0.7,
    convex hull.
    """
    trained = SegmentationContext(
        Views(Scene(gaussians, backend=backend), cameras, render_side=settings.render_side),
        Photos(photo_folder, settings.photo_side, sam_factory, embeddings),
        label_maps,
        looks_file,
    )
    return _find(trained, prompt, settings, detector_factory=detector_factory, emit=emit, should_stop=should_stop)


def _find(
    trained: SegmentationContext,
    prompt: Prompt,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
) -> list[FoundObject]:
    looks = None
    by_groups = settings.n_groups > 0 and settings.n_rescored > 0
    if isinstance(prompt, TextPrompt) and by_groups and detector_factory().knows(prompt.text).known:
        looks = trained.looks(detector_factory(), emit=part_of(emit, 0, 2), should_stop=should_stop)
        emit = part_of(emit, 1, 2)
    seeds = find_evidence(
        prompt,
        trained.views,
        trained.photos,
        trained.label_maps,
        settings,
        detector_factory=detector_factory,
        emit=emit,
        should_stop=should_stop,
    )
    if isinstance(prompt, TextPrompt):
        if looks is not None:
            seeds += evidence_of_groups(prompt.text, looks, trained.views, detector_factory(), settings.n_groups)
        if not seeds:
            n_photos = min(settings.n_text_views, len(trained.label_maps) or len(trained.views.cameras.cameras))
            raise PromptError(
                f"{prompt.text!r} was not found in {n_photos} photos. Use another word, or click on the object instead."
            )
    return isolate(
        trained, prompt, seeds, settings, detector_factory=detector_factory, emit=emit, should_stop=should_stop
    )


def isolate(
    trained: SegmentationContext,
    prompt: Prompt,
    seeds: Sequence[Seed],
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
    accepted: bool = False,
) -> list[FoundObject]:
    """Return the objects that seed masks show, the best first; at least one.

    Parameters
    ----------
    trained : SegmentationContext
    prompt : Prompt
        What `seeds` were found by. The seeds of a click are one object, those of a text may be several.
    seeds : sequence of Seed
    settings : SegmentSettings
    detector_factory : callable
        Called only for a text.
    emit, should_stop
        See `engine.events`.
    accepted : bool
        The person said that these are it: a text is not refused.

    Raises
    ------
    PromptError
        When nothing was found; `NothingAlike` when what was found is too little like the text.
    Cancelled
        When `should_stop` says so.
    """
    if isinstance(prompt, TextPrompt):
        text, detector = prompt.text, detector_factory()
        return _isolate_named(trained, text, seeds, settings, detector, emit, should_stop, accepted=accepted)
    candidates = gather(trained.views, seeds, settings, should_stop)
    _some(candidates)
    scored = [(candidate.seeds[0].score, candidate) for candidate in candidates]
    memberships = [finish(trained, candidate, settings, should_stop) for candidate in candidates]
    if isinstance(prompt, ClickPrompt) and len(scored) > 1:
        # Clicks in several photos show one object, even where no mask shows all of it.
        best = max(scored, key=lambda pair: pair[0])[1]
        everything = [seed for candidate in candidates for seed in candidate.seeds]
        whole = Candidate(best.best, [*best.seeds, *(seed for seed in everything if seed not in best.seeds)], best.fit)
        scored = [(max(score for score, _ in scored), whole)]
        memberships = [np.maximum.reduce(memberships)]
    found: list[FoundObject] = []
    for number, ((score, candidate), membership) in enumerate(zip(scored, memberships, strict=True)):
        if prompt.excluded:
            membership = _corrected(trained, prompt, membership, seeds, settings, should_stop)
        if not any(overlap(membership, other.membership) > settings.same_object for other in found):
            # A mask that the person drew is the whole object.
            given = candidate.seeds[0].given
            levels = Levels((membership,)) if given else _levels(trained, candidate, membership, settings, should_stop)
            found.append(_found(trained, candidate, levels, score))
        emit(Progress("objects", 0.7 + 0.3 * (number + 1) / len(scored), message="Isolating"))
    return found


def _isolate_named(
    trained: SegmentationContext,
    text: str,
    seeds: Sequence[Seed],
    settings: SegmentSettings,
    detector: Detector,
    emit: Emit,
    should_stop: StopCheck,
    *,
    accepted: bool,
) -> list[FoundObject]:
    """Return what of the seeds is named by `text`; errors as in `isolate`."""
    by_looks = settings.n_rescored > 0 and not accepted
    candidates = (gather_for_text if by_looks else gather)(trained.views, seeds, settings, should_stop)
    _some(candidates)
    ranked = [(candidate.seeds[0].score, candidate) for candidate in candidates]
    looks = trained.looks(detector, emit=emit, should_stop=should_stop) if by_looks and settings.n_groups else None
    hierarchy = None if looks is None else looks.hierarchy
    judge = TextJudge(text, trained.views, trained.photos, detector, settings, hierarchy)
    if not accepted:
        ranked = rank_for_text(judge, candidates, should_stop)
    found: list[FoundObject] = []
    refused: list[tuple[float, Candidate]] = []
    for number, (score, candidate) in enumerate(ranked):
        emit(Progress("objects", 0.7 + 0.3 * number / len(ranked), message="Isolating"))
        if len(found) == settings.max_objects or (found and score < settings.relative_score * ranked[0][0]):
            break
        if not found and len(refused) == _TRIES:
            break
        if any(overlap(candidate.best.membership, other.membership) > settings.same_object for other in found):
            continue
        membership = finish(trained, candidate, settings, should_stop)
        if by_looks and judge.whole(membership >= THRESHOLD) < _WORSE * judge.whole(candidate.best.members):
            membership = candidate.best.membership
        if any(overlap(membership, other.membership) > settings.same_object for other in found):
            continue
        levels = _levels(trained, candidate, membership, settings, should_stop, judge.whole, hierarchy)
        if by_looks:
            # A version that stands out less, since its foot is like what it stands on, is no less surely it.
            score = max(judge.score(candidate, one >= THRESHOLD) for one in (membership, levels.membership))
        if by_looks and score < settings.least_score:
            refused.append((score, candidate))
        else:
            found.append(_found(trained, candidate, levels, score))
    emit(Progress("objects", 1.0, message="Isolating"))
    if not found:
        nearest = sorted(refused, key=lambda pair: -pair[0])
        for score, candidate in ranked:  # those that nothing more was spent on come behind
            if not any(
                overlap(candidate.best.membership, other.best.membership) > settings.same_object for _, other in nearest
            ):
                nearest.append((score, candidate))
        raise nothing_alike(text, nearest, settings)
    best = max(one.score for one in found)
    kept = [one for one in found if one.score >= settings.relative_score * best or not by_looks]
    return sorted(kept, key=lambda one: -one.score)


def _some(candidates: Sequence[Candidate]) -> None:
    if not candidates:
        raise PromptError(
            "No Gaussian of the scene lies behind what was found in the photos. Choose another photo or prompt."
        )


def _found(trained: SegmentationContext, candidate: Candidate, levels: Levels, score: float) -> FoundObject:
    best = candidate.seeds[0]
    fit = fit_of(trained.views, best.view, best.mask, levels.membership)
    return FoundObject(levels.membership, score, fit, tuple(candidate.seeds), levels)


def _corrected(
    trained: SegmentationContext,
    prompt: ClickPrompt | BoxPrompt | MaskPrompt,
    membership: Float32,
    seeds: Sequence[Seed],
    settings: SegmentSettings,
    should_stop: StopCheck,
) -> Float32:
    clicks = prompt.clicks if isinstance(prompt, ClickPrompt) else ()
    kept = membership >= THRESHOLD
    away = taken_away(
        prompt.excluded, clicks, kept, trained.views, trained.photos, trained.label_maps, settings, should_stop
    )
    corrected = without(membership, away)
    if not (corrected >= THRESHOLD).any():
        raise PromptError("Nothing is left of the object without what the other clicks took away. Click elsewhere.")
    return corrected


def _levels(
    trained: SegmentationContext,
    candidate: Candidate,
    membership: Float32,
    settings: SegmentSettings,
    should_stop: StopCheck,
    judge: Callable[[NDArray[np.bool_]], float] | None = None,
    hierarchy: Hierarchy | None = None,
) -> Levels:
    if settings.n_level_views == 0:
        return Levels((membership,))
    return levels_of(
        trained.views,
        trained.photos,
        membership,
        candidate.best.directions,
        settings,
        encoded=trained.label_maps,
        judge=judge,
        hierarchy=hierarchy,
        should_stop=should_stop,
    )


def finish(
    trained: SegmentationContext, candidate: Candidate, settings: SegmentSettings, should_stop: StopCheck
) -> Float32:
    """Return the membership of a candidate after the votes and the completion, shape [N], float32."""
    lifted = candidate.best
    if settings.refinement == "votes":
        best = candidate.seeds[0]
        seed = (best.view, best.mask) if best.given else None
        lifted = refine_by_votes(trained.views, lifted, seed, trained.label_maps, settings, should_stop=should_stop)
    return complete(trained.views, lifted, settings)


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
    backend: Backend = "cpu",
    trained: SegmentationContext | None = None,
) -> list[ObjectRecord]:
    """Isolate what `prompt` asks for in a trained project and store each match as an object of its own.

    Parameters
    ----------
    project : ProjectFolder
        SegmentationContext, and held for writing.
    prompt : Prompt
    name : str
        Of the objects; further matches get ``-2``, ``-3``...
    settings : SegmentSettings
    detector_factory, sam_factory : callable
        Called only when their model is needed.
    emit, should_stop
        See `engine.events`.
    backend : {"cpu", "reference"}
    trained : SegmentationContext, optional
        Of this project, when several prompts follow each other.

    Returns
    -------
    list of ObjectRecord
        Those stored now, the best first.

    Raises
    ------
    PromptError
        When nothing was found. What came nearest to a text is then kept (`engine.objects.candidate_file`).
    HeritageError
        When a part of the project is missing or damaged.
    """
    started = time.perf_counter()
    trained = trained or load_context(project, settings, sam_factory, backend=backend)
    try:
        found = _find(
            trained, prompt, settings, detector_factory=detector_factory, emit=part_of(emit, 0, 2),
            should_stop=should_stop,
        )  # fmt: skip
    except PromptError as error:
        if isinstance(prompt, TextPrompt):
            nearest = error.candidates if isinstance(error, NothingAlike) else ()
            remember_candidates(project.path, prompt.text, str(error), nearest, trained.photos)
        raise PromptError(str(error)) from error
    asked = describe_prompt(prompt)
    if isinstance(prompt, TextPrompt):
        asked["detector"] = detector_factory().name
    return store_found(
        project, trained, found, asked, name, settings, started, emit=part_of(emit, 1, 2), should_stop=should_stop
    )
