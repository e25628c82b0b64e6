"""Segmentation by a prompt: its evidence is lifted to the Gaussians, and what a text names is found among proposals."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import PromptError
from ..events import Emit, Progress, StopCheck, part_of
from ..project_folder import ProjectFolder
from ..rasterizer import PROCESSOR, Device
from ..records import ObjectRecord
from ..scene import Camera, PinholeCamera
from .candidate_file import remember_candidates
from .context import SegmentationContext, load_context
from .evidence import (
    DetectorFactory,
    evidence_of_places,
    find_evidence,
    nothing_behind,
    nothing_found,
    require_known,
)
from .found import FoundObject, NoMatchError, ObjectRequest, fit_of, overlap, store_found
from .lifting import Levels, lift, lift_levels
from .paper import find_objects_of_paper
from .photos import SamFactory
from .prompts import Prompt, TextPrompt, describe_prompt
from .settings import PaperSettings, SegmentSettings
from .spatial import Extent, choose, parse_spatial, showing_camera
from .votes import THRESHOLD, MaskEvidence

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = ["find_objects", "isolate_object", "mask_at", "segment_project"]

Mask = NDArray[np.bool_]


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
    found = isolate_object(context, find_evidence(prompt, context), settings, should_stop)
    emit(Progress("objects", 1.0, message="Isolating"))
    return [found]


def mask_at(
    context: SegmentationContext,
    camera: Camera | PinholeCamera,
    click: tuple[float, float],
    settings: SegmentSettings,
    should_stop: StopCheck,
) -> Mask:
    """Return where the object under a pixel of any view of the scene is visible in that view.

    Parameters
    ----------
    context : SegmentationContext
    camera : Camera or PinholeCamera
        Of a photo, or any other one.
    click : (float, float)
        x, y in pixels of the picture; (0, 0) is its top left corner.
    settings : SegmentSettings
    should_stop : callable

    Returns
    -------
    bool array of shape [camera.height, camera.width]

    Raises
    ------
    PromptError
        When the click lies outside of the picture, or no Gaussian is there.
    Cancelled
        When `should_stop` returns True.
    """
    x, y = click
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        raise PromptError(
            f"The click {x:g},{y:g} lies outside of the picture, {camera.width} x {camera.height} pixels."
        )
    view = context.views.from_anywhere(camera)
    found = isolate_object(context, [evidence_of_places([click], view, context)], settings, should_stop)
    return view.to_photo(context.views.visible_share(view, found.membership >= THRESHOLD) > THRESHOLD)


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
        levels = Levels((lift(context, evidence, settings, should_stop=should_stop),))
    else:
        levels = lift_levels(context, evidence, settings, should_stop)
    if not (levels.membership >= THRESHOLD).any():
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
    if not spatial.word:
        return _find_named(context, spatial.noun, settings, detector, emit, should_stop)
    found = _find_named(context, spatial.noun, settings, detector, part_of(emit, 0, 2), should_stop)
    others: list[FoundObject] = []
    if spatial.other:
        with contextlib.suppress(NoMatchError):  # `choose` says that there is none
            others = _find_named(context, spatial.other, settings, detector, part_of(emit, 1, 2), should_stop)
    means = context.views.scene.gaussians.means
    extents, other_extents = (
        [Extent.of(means[one.membership >= THRESHOLD]) for one in kind] for kind in (found, others)
    )
    camera = prompt.camera or showing_camera(context.views.cameras.cameras, extents)
    return [found[number] for number in choose(spatial, extents, other_extents, camera)]


def _find_named(
    context: SegmentationContext,
    text: str,
    settings: SegmentSettings,
    detector: Detector,
    emit: Emit,
    should_stop: StopCheck,
) -> list[FoundObject]:
    """Return the objects that a text names; errors as in `find_objects`."""
    require_known(text, detector)
    looks = context.looks(detector, settings, emit=part_of(emit, 0, 2), should_stop=should_stop)
    isolating = part_of(emit, 1, 2)
    isolating(Progress("objects", 0.0, message=f"Looking for {text!r} ({detector.name})"))
    scores = looks.scores(text, detector, context.views, context.photos, settings.n_text_views)
    if not scores.any():
        raise nothing_found(text, context, settings)
    # The best first, without versions of better ones.
    different: list[int] = []
    for number in np.argsort(-scores, kind="stable"):
        members = looks.members[number].astype(np.float32)
        same = (overlap(members, looks.members[k].astype(np.float32)) for k in different)
        if len(different) < settings.max_objects and not any(share > settings.same_object for share in same):
            different.append(int(number))
    least = max(settings.least_score, settings.relative_score * float(scores.max()))
    wanted = [number for number in different if scores[number] >= least]
    nearest = [number for number in different if scores[number] >= THRESHOLD * scores.max()]
    found = []
    for done, number in enumerate(wanted or nearest):
        item = looks.evidence(number, float(scores[number]), context.views)
        found.append(isolate_object(context, [item], settings, should_stop))
        isolating(Progress("objects", (done + 1) / len(wanted or nearest), message="Isolating"))
    if not wanted:
        raise NoMatchError(
            f"Nothing in the photos looks enough like {text!r} (best match {found[0].score:.2f}, needed "
            f"{settings.least_score:.2f}). Use another word, or click on the object instead.",
            found,
        )
    return found


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
    context = load_context(project, settings, sam_factory, device=device, emit=emit)
    return segment_prompt(
        project, context, prompt, name, settings,
        detector_factory=detector_factory, emit=emit, should_stop=should_stop,
    )  # fmt: skip


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
    try:
        found = find_objects(
            context, prompt, settings,
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
