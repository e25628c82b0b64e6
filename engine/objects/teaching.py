"""Objects that teach words: in a project that learns, each object that the user named or accepted is one example.

What is kept of it, in the user's own vocabulary, are the mean descriptions of its crops; see docs/any_word.md.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime

from ..core.arrays import Float32
from ..core.words import normalised
from ..project.folder import ProjectFolder, stage_key
from ..project.objects import ObjectRecord, list_objects, membership_in
from ..project.own_words import Example, OwnWords, same_word
from .context import SegmentationContext
from .known_objects import BACKGROUND
from .spatial import parse_spatial

_UNNAMED = "object"
"""Name of an object that was clicked, boxed or painted and not named, see `engine.cli.commands.segment`."""
_NUMBER = re.compile(r"[\s-]+\d+$")
"""The number that `new_name` adds to the second object of a name."""


def taught_word(record: ObjectRecord) -> str:
    """Return the word that an object teaches; empty for one whose name the user neither gave nor accepted.

    What a word found by itself teaches nothing, and so does a name that was only suggested: mistakes would teach more
    mistakes. Once it was renamed, its new name is the user's.
    """
    name, prompt = _NUMBER.sub("", record.name).strip(), record.prompt
    kind = prompt.get("kind")
    given = {"text": prompt.get("text"), "all": prompt.get("name")}.get(str(kind), _UNNAMED)
    if kind == "text" and prompt.get("accepted"):
        given = ""
    if kind == BACKGROUND or not isinstance(given, str) or same_word(name, given) or same_word(name, _UNNAMED):
        return ""
    # "The left vase" is a vase.
    word = parse_spatial(name).noun
    return word if normalised(word) else ""


def learn(project: ProjectFolder, own: OwnWords, context: SegmentationContext) -> list[str]:
    """Teach what the objects of a project have to teach and did not teach yet, and return these words.

    Objects that were changed or renamed since teach anew, in the place of what they taught.

    Parameters
    ----------
    context : SegmentationContext
        Its detector describes the objects. One that describes no crops learns nothing.

    Raises
    ------
    FormatError
        When an object or the vocabulary is damaged.
    PromptError, DiskError, ProjectInUse
        As of `OwnWords.add`.
    Cancelled
        When the user stops.
    """
    from .looks import describe_members  # what was kept is taught without it

    wanted = [(record, word) for record in list_objects(project.path) if (word := taught_word(record))]
    if not wanted or not (fingerprint := context.detector.fingerprint):
        return []
    known = {one.source: (one.word, one.state) for one in own.examples(fingerprint)}
    found = []
    for record, word in wanted:
        if record.n_scene_gaussians != len(context.means):
            continue
        source, state = _source_and_state(project, record)
        if known.get(source) == (word, state):
            continue
        members = membership_in(project.path, record, len(context.means)) >= record.threshold
        rows = context.detector.example_vectors(describe_members(members, context))
        if len(rows):
            found.append(Example(word, source, state, context.detector.name, fingerprint, _now(), rows.mean(axis=0)))
    if found:
        own.add(found)
    return list(dict.fromkeys(one.word for one in found))


def teach_kept(
    project: ProjectFolder, own: OwnWords, record: ObjectRecord, example: Float32, detector: str, fingerprint: str
) -> None:
    """Teach the word of an object whose description was kept, so that no model is needed.

    Parameters
    ----------
    record : ObjectRecord
        Of the stored object.
    example : array of shape [E], float32
        The mean of its `Detector.example_vectors`.
    detector, fingerprint : str
        Of the detector that described it.

    Raises
    ------
    FormatError
        When the vocabulary is damaged.
    PromptError, DiskError, ProjectInUse
        As of `OwnWords.add`.
    """
    if word := taught_word(record):
        own.add([Example(word, *_source_and_state(project, record), detector, fingerprint, _now(), example)])


def _source_and_state(project: ProjectFolder, record: ObjectRecord) -> tuple[str, str]:
    """Return hashes that name an object, and that change when it is changed."""
    scene = project.recorded_outputs("training")
    state = stage_key(record.created, record.n_gaussians, record.threshold, record.level, list(record.refined))
    return stage_key(scene, record.id)[:32], state[:32]


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
