"""Segmentation: the objects of a scene that a prompt asks for, or all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core.arrays import Float64, Mask
from ..core.errors import PhotoError, PromptError
from ..core.events import Warned
from ..core.parts import part
from ..core.words import likeness
from ..scene import Camera, PinholeCamera
from .choosing import answers_of, objects_of, offers_of, scene_objects
from .context import SegmentationContext
from .evidence import evidence_of_places, find_evidence, unknown_word
from .found import MAX_COMMON, FoundObject, is_same, nothing_found
from .graph import bounded
from .grounding import PromptCheck
from .lifting import isolate_object, isolate_proposal, levels_of_each
from .looks import Looks, kept_looks, load_or_build_looks
from .meant import boxed_evidence, likelier_evidence, whole_evidence
from .paper import find_objects_of_paper
from .prompts import BoxPrompt, ClickPrompt, Place, Prompt, TextPrompt, camera_of_prompt
from .settings import MEMBER_THRESHOLD, SURE_SCORE, PaperSettings
from .spatial import Extent, choose, parse_spatial, showing_camera
from .views import inner_box
from .votes import MaskEvidence

_MIN_NAME_SCORE = 0.17  # chosen on museum_room
"""Score of the detector from which on a name is suggested."""

_LOOKS = {
    "hardly": "hardly looks like it",
    "a little": "looks a little like it",
    "probably": "looks much like it",
    "clearly": "looks much like it",
}

_CHOOSE = "Or choose among the objects that are offered: those that look most like it come first."


class NoMatchError(PromptError):
    """Nothing in the scene looks enough like the text.

    Attributes
    ----------
    candidates : tuple of MaskEvidence
        Whole objects of the scene, with their Gaussians: what looks most like it first, with its score.
    suggestions : tuple of str
        Words that fit what looks most like it better.
    """

    def __init__(self, message: str, candidates: Sequence[MaskEvidence], suggestions: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.candidates, self.suggestions = tuple(candidates), tuple(suggestions)


class UnknownWordError(NoMatchError):
    """The detector does not know the text, and it was not taught.

    Its candidates are what looks most like the text where pictures taught it, otherwise the likeliest objects.

    Attributes
    ----------
    reason : str
        The message without what it says of the candidates.
    """

    def __init__(self, reason: str, candidates: Sequence[MaskEvidence], *, by_likeness: bool) -> None:
        super().__init__(f"{reason} {_CHOOSE}" if candidates and by_likeness else reason, candidates)
        self.reason = reason


def find_objects(context: SegmentationContext, prompt: Prompt) -> list[FoundObject]:
    """Return the objects of a scene that `prompt` asks for, the best first; at least one.

    Raises
    ------
    NoMatchError
        When every candidate looks too little like a text.
    PromptError
        When no object was found for another reason.
    Cancelled
        When the user stops.
    """
    if isinstance(context.settings, PaperSettings):
        return find_objects_of_paper(context, prompt, context.settings)
    if isinstance(prompt, TextPrompt):
        return _find_text(context, prompt)
    if isinstance(prompt, ClickPrompt):
        found = _find_clicked(context, prompt)
    else:
        whole = _boxed(context, prompt) if isinstance(prompt, BoxPrompt) else None
        found = isolate_object(context, whole or find_evidence(prompt, context))
    context.tell(1.0, "Isolating")
    return [found]


def _boxed(context: SegmentationContext, prompt: BoxPrompt) -> list[MaskEvidence] | None:
    camera_of_prompt(prompt, context.views.cameras)  # a wrong box is told before the scene is looked at
    return boxed_evidence(context, prompt, _objects_of_scene(context.part(0, 2)))


def _objects_of_scene(context: SegmentationContext) -> Mask:
    """Return `scene_objects`; none, with a warning, where a photo that shows them is gone."""
    try:
        return scene_objects(context)
    except PhotoError as error:
        context.emit(Warned(f"{error} Without it, the answer may be a part of an object."))
        return np.zeros((0, len(context.means)), bool)


def _find_clicked(context: SegmentationContext, prompt: ClickPrompt) -> FoundObject:
    """Return the object that clicks mean; errors as in `find_objects`."""
    evidence = find_evidence(prompt, context)
    whole = whole_evidence(context, prompt.clicks, evidence, _objects_of_scene(context.part(0, 2)))
    found = isolate_object(context, whole or evidence)
    # What is excluded says what the object is not, which the comparison does not know.
    if whole is not None or prompt.excluded:
        return found
    likelier = likelier_evidence(context, prompt.clicks, evidence, found.members)
    changed = any(one is not other for one, other in zip(likelier, evidence, strict=True))
    return isolate_object(context, likelier) if changed else found


def mask_at(context: SegmentationContext, camera: Camera | PinholeCamera, click: Place) -> Mask:
    """Return where the object under a pixel of any view of the scene is visible in that view.

    Parameters
    ----------
    camera : Camera or PinholeCamera
        That of a photo, or any other one.
    click : (float, float)
        x, y in pixels of the picture from its top left corner.

    Returns
    -------
    array of shape [height, width], bool
        The full size of `camera`.

    Raises
    ------
    PromptError
        When the click lies outside of the picture, or no Gaussian is there.
    Cancelled
        When the user stops.
    """
    x, y = click
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        size = f"{camera.width} x {camera.height} pixels"
        raise PromptError(f"The click {x:g},{y:g} lies outside of the picture, {size}.")
    view = context.views.from_anywhere(camera)
    found = isolate_object(context, [evidence_of_places([click], view, context)])
    return view.to_photo(context.views.visible(view, found.members))


def _find_text(context: SegmentationContext, prompt: TextPrompt) -> list[FoundObject]:
    """Return the objects that a text names, of which its spatial word may choose some; errors as in `find_objects`."""
    spatial = parse_spatial(prompt.text)
    if not spatial.word:
        return _find_named(context, spatial.noun)
    found = _find_named(context.part(0, 2), spatial.noun)
    others: list[FoundObject] = []
    if spatial.other:
        try:
            others = _find_named(context.part(1, 2), spatial.other)
        except UnknownWordError as error:
            raise PromptError(error.reason) from error  # its pictures would be named by the whole text
        except NoMatchError:
            pass  # `choose` says that there is none
    means = context.means
    extents, other_extents = ([Extent(*inner_box(means[one.members])) for one in kind] for kind in (found, others))
    camera = prompt.camera or showing_camera(context.views.cameras.cameras, extents)
    return [found[number] for number in choose(spatial, extents, other_extents, camera)]


def _find_named(context: SegmentationContext, text: str) -> list[FoundObject]:
    """Return the objects that a text names; errors as in `find_objects`."""
    check = context.detector.check_prompt(text)
    taught, others = context.taught(text)
    looks = _looks_for(check, text, context, is_taught=len(taught) > 0)
    context = context.part(1, 2)
    context.tell(0.0, f"Looking for {text!r} ({context.detector.name})")
    if len(taught):
        scores = looks.scores_of_examples(taught, others, context.detector, text if check.known else "")
    else:
        with part("comparing with the word"):
            scores = looks.scores(text, context)
    found: list[FoundObject] = []
    answers = _answers(looks, scores, text, context, is_taught=len(taught) > 0)
    for done, (number, score) in enumerate(answers, start=1):
        with part("isolating"):
            object_ = isolate_proposal(context, looks.evidence(number, score, context))
        # With its foot, an answer may be the same as a better one.
        if not any(is_same(object_.members, other.members) for other in found):
            found.append(object_)
        context.tell(done / len(answers), "Isolating")
    return found


def _looks_for(check: PromptCheck, text: str, context: SegmentationContext, *, is_taught: bool) -> Looks:
    """Return what the proposals of the scene look like; raise `UnknownWordError` for a text that nothing can answer."""
    if check.known or is_taught:
        return load_or_build_looks(context.part(0, 2))
    # A misspelt word is answered by suggestions. No scene is looked at for it that was not before.
    look = kept_looks if check.misspelt else load_or_build_looks
    looks = look(context.part(0, 2))
    scores = None if looks is None else looks.scores_of_unknown(text, context.detector)
    offered = [] if looks is None else _offered(looks, scores, context.part(1, 2))
    raise UnknownWordError(unknown_word(text, check), offered, by_likeness=scores is not None)


def _answers(
    looks: Looks, scores: Float64, text: str, context: SegmentationContext, *, is_taught: bool
) -> list[tuple[int, float]]:
    """Return the proposals that answer a text, with their scores; raise `NoMatchError` if there are none."""
    if not scores.any():
        raise NoMatchError(nothing_found(text, context), _offered(looks, None, context))
    answers = answers_of(looks, scores, context.settings)
    if not answers:
        nearest = _LOOKS[likeness(float(scores.max()), SURE_SCORE)]
        raise NoMatchError(
            f"Nothing in the photos looks enough like {text!r}: the nearest {nearest}. Use "
            "another word, or click on the object instead.",
            _offered(looks, scores, context),
        )
    if is_taught:
        return answers
    fitting = [looks.fitting_word(number, text, context) for number, _ in answers]
    accepted = [answer for answer, other in zip(answers, fitting, strict=True) if not other]
    if not accepted:
        raise NoMatchError(
            f"What looks most like {text!r} looks more like {fitting[0]!r}. Ask for that, or choose among the "
            "pictures.",
            _offered(looks, scores, context),
            list(dict.fromkeys(fitting)),
        )
    return accepted


def _offered(looks: Looks, scores: Float64 | None, context: SegmentationContext) -> list[MaskEvidence]:
    """Return what `offers_of` offers as evidence, with score 0 where nothing is known of the word."""
    numbers, detector = offers_of(looks, scores, list(context.stored().values())), context.detector
    each = (looks.evidence(number, 0.0 if scores is None else float(scores[number]), context) for number in numbers)
    return [replace(one, example=looks.example(number, detector)) for number, one in zip(numbers, each, strict=True)]


def find_everything(context: SegmentationContext) -> list[FoundObject]:
    """Return the objects of a scene without its background, in descending order of score; no two overlap.

    They are those of `objects_of`. Names are suggested by the detector; without one the score is 0.

    Raises
    ------
    Cancelled
        When the user stops.
    """
    looks = load_or_build_looks(context.part(0, 2))
    context = context.part(1, 2)
    chosen = objects_of(looks)
    objects: list[FoundObject] = []
    taken = np.zeros(len(context.means), bool)
    # Where two reach into each other, the likelier object keeps its Gaussians.
    evidence = [looks.evidence(number, 1.0, context) for number in chosen]
    each = zip(levels_of_each(context, evidence), looks.names(chosen, context), strict=True)
    for done, (levels, name) in enumerate(each, start=1):
        if levels is None:  # all of it is drawn to what surrounds it
            continue
        members = levels.memberships[levels.chosen] >= MEMBER_THRESHOLD
        # The foot of a likelier object may be most of what was chosen.
        if (members & taken).sum() > MAX_COMMON * members.sum():
            continue
        free = (np.where(taken, np.float32(0), one) for one in levels.memberships)
        levels = replace(levels, memberships=tuple(bounded(one, context.means) for one in free))
        suggested, score = name if name[1] >= _MIN_NAME_SCORE else ("", 0.0)
        object_ = FoundObject(levels, score, name=suggested)
        if object_.members.any():
            objects.append(object_)
            taken |= object_.members
        context.tell(done / len(chosen), "Isolating")
    return sorted(objects, key=lambda item: -item.score)
