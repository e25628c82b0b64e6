"""Ranking of a text's candidates by their appearance from all sides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled, PromptError
from ..events import StopCheck
from ..masks import mask_iou
from .candidates import Candidate, fit_of
from .context import SegmentationContext
from .crops import crop_photos
from .hierarchy import Hierarchy
from .lifting import lift
from .settings import SegmentSettings
from .votes import MaskEvidence

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = ["NoMatchError", "TextScorer", "build_text_candidates", "no_match_error", "rank_for_text"]

Mask = NDArray[np.bool_]

_SAME_CANDIDATE_IOU = 0.85  # chosen on museum_room
"""IoU of the Gaussians above which two pieces of evidence of a text are one candidate."""

_MIN_RELATIVE_SCORE = 0.5  # chosen on museum_room, store_room
"""Smallest score of a candidate relative to the best one. Candidates below it are discarded."""


class NoMatchError(PromptError):
    """No candidate looks enough like the text.

    Attributes
    ----------
    candidates : tuple of (float, Candidate)
        The nearest ones with their scores, the best first.
    """

    def __init__(self, message: str, candidates: Sequence[tuple[float, Candidate]]) -> None:
        super().__init__(message)
        self.candidates = tuple(candidates)


def build_text_candidates(
    context: SegmentationContext, evidence: Sequence[MaskEvidence], settings: SegmentSettings, should_stop: StopCheck
) -> list[Candidate]:
    """Lift the evidence of a text: the segments with the best scores, and all groups of Gaussians.

    There are at most `n_rescored` candidates of segments, each led by the mask with the best fit. Unlike in
    `build_candidates`, a part and its whole stay two candidates, and their appearance from all sides decides between
    them.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """
    candidates: list[Candidate] = []
    for item in sorted(evidence, key=lambda item: (item.members is not None, -item.score)):
        if item.members is None and len(candidates) >= settings.n_rescored:
            continue
        if should_stop():
            raise Cancelled("Stopped while isolating; no object was stored.")
        lifted = lift(context, [item], settings, should_stop=should_stop)
        if not lifted.members.any():
            continue
        fit = fit_of(context.views, item.view, item.mask, lifted.membership)
        same = next((c for c in candidates if mask_iou(c.best.members, lifted.members) > _SAME_CANDIDATE_IOU), None)
        if same is None:
            candidates.append(Candidate(lifted, [item], fit))
        else:
            same.add(item, lifted, fit, better=fit > same.fit)
    return candidates


class TextScorer:
    """Similarity of Gaussians to a text, by their appearance in photos. Results are kept.

    Parameters
    ----------
    text : str
    context : SegmentationContext
    detector : Detector
    settings : SegmentSettings
        `n_crop_views`.
    hierarchy : Hierarchy, optional
        The scene's groups.
    """

    def __init__(
        self,
        text: str,
        context: SegmentationContext,
        detector: Detector,
        settings: SegmentSettings,
        hierarchy: Hierarchy | None = None,
    ) -> None:
        self.text, self.views, self.settings = text, context.views, settings
        self._photos, self._detector, self._hierarchy = context.photos, detector, hierarchy
        self._similarities: dict[bytes, float] = {}

    def similarity(self, members: Mask) -> float:
        """Return how much the members, bool [N], look like a whole object of the text's kind, 0 to 1.

        The average of the mean and the median over the photos, so that a version must win from most sides. See
        docs/design_notes/objects.md.
        """
        key = np.packbits(members).tobytes()
        if key not in self._similarities:
            scores: list[float] = []
            for pixels, box, mask in crop_photos(self.views, members, self._photos, self.settings):
                scores += self._detector.score_crops(pixels, [box], self.text, masks=[mask])
            self._similarities[key] = float(np.mean(scores) + np.median(scores)) / 2 if scores else 0.0
        return self._similarities[key]

    def score(self, candidate: Candidate, members: Mask) -> float:
        """Return the confidence that a candidate, completed to `members`, bool [N], is what the text names, 0 to 1.

        The geometric mean of the detector's best score of a single segment and of the members' similarity to the text,
        times the square root of their prominence where the scene's groups are known. The similarity excludes segments
        that look like something else from other sides or contain more than the object. The prominence excludes parts of
        an object, and objects with their support. See docs/design_notes/objects.md.
        """
        prominence = 1.0 if self._hierarchy is None else self._hierarchy.prominence_of(members)
        return float(np.sqrt(max(item.score for item in candidate.evidence) * self.similarity(members) * prominence))


def rank_for_text(
    scorer: TextScorer, candidates: Sequence[Candidate], should_stop: StopCheck
) -> list[tuple[float, Candidate]]:
    """Return the candidates worth completing with their scores, the best first; at least one.

    Parameters
    ----------
    scorer : TextScorer
        Of its settings, `least_candidate` is used.
    candidates : sequence of Candidate
    should_stop : callable

    Returns
    -------
    list of (float, Candidate)
        Several versions of one object may be among them.

    Raises
    ------
    NoMatchError
        When the best candidate scores less than `least_candidate`.
    Cancelled
        When `should_stop` returns True.
    """
    settings = scorer.settings
    scored = []
    for candidate in candidates:
        if should_stop():
            raise Cancelled("Stopped while comparing what was found; no object was stored.")
        scored.append((scorer.score(candidate, candidate.best.members), candidate))
    scored.sort(key=lambda pair: -pair[0])
    if scored[0][0] < settings.least_candidate:
        raise no_match_error(scorer.text, scored, settings)
    return [(score, candidate) for score, candidate in scored if score >= _MIN_RELATIVE_SCORE * scored[0][0]]


def no_match_error(text: str, scored: Sequence[tuple[float, Candidate]], settings: SegmentSettings) -> NoMatchError:
    """Return the error for a `text` without a match; `scored` are the nearest candidates, the best first."""
    return NoMatchError(
        f"Nothing in the photos looks enough like {text!r} (best match {scored[0][0]:.2f}, needed "
        f"{settings.least_score:.2f}). Use another word, or click on the object instead.",
        scored,
    )
