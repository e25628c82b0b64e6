"""Texts that were refused: what is stored of them and offered instead. `segment.py` makes the sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ..core.arrays import Mask
from ..core.words import normalised, similarly_spelt
from ..project.objects import list_objects
from .candidate_file import remember_candidates
from .context import SegmentationContext
from .evidence import meant_by
from .found import is_same
from .grounding import offered_model
from .known_objects import BACKGROUND
from .votes import MaskEvidence, undecided_by


def remember_refusal(
    project: Path,
    text: str,
    message: str,
    candidates: Sequence[MaskEvidence],
    context: SegmentationContext,
    *,
    suggestions: Sequence[str] = (),
) -> str:
    """Store a refused text with what it may have been meant for, and return its message with the objects named so.

    Parameters
    ----------
    candidates : sequence of MaskEvidence
        With their Gaussians, the best first.
    suggestions : sequence of str
        Words that fit better; by default, what an unknown text may have been meant for.

    Raises
    ------
    FormatError
        When a stored object is damaged.
    DiskError
        When a file cannot be written.
    """
    ids = {one.name: one.id for one in list_objects(project) if one.id != BACKGROUND}
    alike = similarly_spelt([normalised(text)], ids)
    if alike:
        message += f" The scene has an object that is called {' or '.join(map(repr, alike))}."
    stored = context.stored()
    same = [_stored_as(one, stored) for one in candidates]
    whole = [replace(one, undecided=undecided_by(context.views, one)) for one in candidates]
    remember_candidates(
        project, text, message, whole, context.photos,
        suggestions=suggestions or meant_by(text, context.detector),
        offer=offered_model(context.detector.name),
        alike=[ids[name] for name in alike],
        same=same,
        graph=context.graph.key if candidates else "",
        detector=context.detector.name,
        fingerprint=context.detector.fingerprint,
    )  # fmt: skip
    return message


def _stored_as(candidate: MaskEvidence, stored: Mapping[str, Mask]) -> str | None:
    """Return the id of the stored object that a candidate is a version of; None for no object."""
    assert candidate.members is not None
    return next((key for key, members in stored.items() if is_same(members, candidate.members)), None)
