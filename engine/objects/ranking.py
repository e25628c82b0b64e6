"""Which finds of a text are what it names: judged by what they look like from all sides, in 3D."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled, PromptError
from ..events import StopCheck
from .candidates import Candidate, center_of, crops_of, fit_of, overlap
from .evidence import Seed
from .hierarchy import Hierarchy
from .lifting import Lifted, lift, lift_group
from .photos import Photos
from .selection import iou_of
from .settings import SegmentSettings
from .views import Views

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = [
    "NothingAlike",
    "TextJudge",
    "gather_for_text",
    "nothing_alike",
    "rank_for_text",
]

Mask = NDArray[np.bool_]

_SAME_FIND = 0.85
"""IoU of the Gaussians from which on two finds of a text are one."""

_WORTH_A_TRY = 0.5
"""Of the best score: what scores less before votes and levels have made it whole is not looked at any further."""

_FITS = 0.7
"""IoU of a mask with what has its features, rendered in its view, from which on the features know the object."""


class NothingAlike(PromptError):
    """A text that nothing in the photos looks enough like.

    Attributes
    ----------
    candidates : tuple of (float, Candidate)
        What comes nearest with its score: first what votes made whole, then what was only looked at; the best first.
    """

    def __init__(self, message: str, candidates: Sequence[tuple[float, Candidate]]) -> None:
        super().__init__(message)
        self.candidates = tuple(candidates)


def gather_for_text(
    views: Views, seeds: Sequence[Seed], settings: SegmentSettings, should_stop: StopCheck
) -> list[Candidate]:
    """Lift the seeds that score best: `n_rescored` different candidates of segments, led by the best-fitting one of
    each, and all groups of Gaussians.

    Where what has a mask's features does not fit the mask, it is also taken as all there is to see of the object, as if
    the person had given it: that tells a ball from a wall that SAM once merged it with. A part and its whole stay two
    candidates, other than in `gather`: what they look like from all sides decides between them.

    Raises
    ------
    Cancelled
        When `should_stop` says so.
    """
    found: list[Candidate] = []
    for seed in sorted(seeds, key=lambda seed: (seed.members is not None, -seed.score)):
        if seed.members is None and len(found) >= settings.n_rescored:
            continue
        if should_stop():
            raise Cancelled("Stopped while isolating; no object was stored.")
        for read in (seed, replace(seed, given=True)) if seed.members is None else (seed,):
            lifted = _lifted(views, read, settings)
            if lifted is None:
                continue
            fit = fit_of(views, read.view, read.mask, lifted.membership)
            same = next((c for c in found if iou_of(c.best.members, lifted.members) > _SAME_FIND), None)
            if same is None:
                found.append(Candidate(lifted, [read], fit))
            elif fit > same.fit:
                same.best, same.fit = lifted, fit
                same.seeds.insert(0, read)
            else:
                same.seeds.append(read)
            if fit >= _FITS:
                break
    return found


def _lifted(views: Views, seed: Seed, settings: SegmentSettings) -> Lifted | None:
    if seed.members is None:
        return lift(views, seed.view, seed.mask, settings, given=seed.given)
    return lift_group(views, seed.view, seed.mask, seed.members, settings)


class TextJudge:
    """How much Gaussians look like what a text names. What was looked at once is remembered.

    Parameters
    ----------
    text : str
    views : Views
    photos : Photos
    detector : Detector
    settings : SegmentSettings
        `n_crop_views`.
    hierarchy : Hierarchy, optional
        The scene's groups.
    """

    def __init__(
        self,
        text: str,
        views: Views,
        photos: Photos,
        detector: Detector,
        settings: SegmentSettings,
        hierarchy: Hierarchy | None = None,
    ) -> None:
        self.text, self.views, self.settings = text, views, settings
        self._photos, self._detector, self._hierarchy = photos, detector, hierarchy
        self._seen: dict[bytes, float] = {}

    def whole(self, members: Mask) -> float:
        """Return how much members, bool [N], look like a whole one of what the text names, 0 to 1.

        Half of it is the mean over the photos, half the median: a version must win from most sides. A flowerpot with
        its plinth looked better than the pot from the one side where that alone was not recognised.
        """
        key = np.packbits(members).tobytes()
        if key not in self._seen:
            scores: list[float] = []
            for pixels, box, mask in crops_of(self.views, members, self._photos, self.settings):
                scores += self._detector.score_crops(pixels, [box], self.text, masks=[mask])
            self._seen[key] = float(np.mean(scores) + np.median(scores)) / 2 if scores else 0.0
        return self._seen[key]

    def score(self, candidate: Candidate, members: Mask) -> float:
        """Return how surely a candidate that came to be `members`, bool [N], is what the text names, 0 to 1.

        The geometric mean of two: what the detector said of the one segment it was surest of, and what it says of the
        Gaussians, cut out of photos all around; times the root of how much they stand out, where the scene's groups are
        known. A segment that looks like something else from one side, or holds more than the object, is found out by
        the second; a part of an object, or it with its plinth, by the third. Contrast to other words and other
        candidates, spread and agreement over the views were tried beside it, weighted by a logistic fit: on the museum
        room none of them told its ten exhibits better from the 982 words of the vocabulary that name nothing there.
        """
        standing = 1.0 if self._hierarchy is None else self._hierarchy.standing_of(members)
        return float(np.sqrt(max(seed.score for seed in candidate.seeds) * self.whole(members) * standing))


def rank_for_text(
    judge: TextJudge, candidates: Sequence[Candidate], should_stop: StopCheck
) -> list[tuple[float, Candidate]]:
    """Return the candidates worth keeping with their score, the best first; at least one. Versions of one object are
    all there, unless nothing is looked at again.

    Parameters
    ----------
    judge : TextJudge
        Its settings' `n_rescored` and `least_candidate`; `relative_score` and `same_object` where nothing is looked at
        again.
    candidates : sequence of Candidate
    should_stop : callable

    Raises
    ------
    NothingAlike
        When even the best is not worth keeping.
    Cancelled
        When `should_stop` says so.

    Notes
    -----
    The score is that of the judge; with ``n_rescored=0``, `_agreement`.
    """
    settings = judge.settings
    looked_at = {seed.view.camera.photo for candidate in candidates for seed in candidate.seeds}
    scored = []
    for candidate in candidates:
        if should_stop():
            raise Cancelled("Stopped while comparing what was found; no object was stored.")
        score = (
            judge.score(candidate, candidate.best.members)
            if settings.n_rescored
            else _agreement(judge.views, candidate, looked_at)
        )
        scored.append((score, candidate))
    scored.sort(key=lambda pair: -pair[0])
    if scored[0][0] < settings.least_candidate:
        raise nothing_alike(judge.text, scored, settings)
    least = (_WORTH_A_TRY if settings.n_rescored else settings.relative_score) * scored[0][0]
    kept: list[tuple[float, Candidate]] = []
    for score, candidate in scored:
        same = any(overlap(candidate.best.membership, one.best.membership) > settings.same_object for _, one in kept)
        if score >= least and (settings.n_rescored or not same):
            kept.append((score, candidate))
    return kept


def nothing_alike(text: str, scored: Sequence[tuple[float, Candidate]], settings: SegmentSettings) -> NothingAlike:
    """Return the refusal of `text` with what came nearest, the best first."""
    return NothingAlike(
        f"Nothing in the photos looks enough like {text!r} (best match {scored[0][0]:.2f}, needed "
        f"{settings.least_score:.2f}). Use another word, or click on the object instead.",
        scored,
    )


def _agreement(views: Views, candidate: Candidate, looked_at: set[str]) -> float:
    """Return the detector's score averaged over the views it looked at that face the candidate, times its fit.

    Where the detector found something else in such a view, it counts 0: a find that several views agree on wins over
    a louder one of a single view.
    """
    center = center_of(views, candidate.best.members)
    facing = [camera.photo for camera in views.facing(center) if camera.photo in looked_at]
    by_photo: dict[str, float] = {}
    for seed in candidate.seeds:
        photo = seed.view.camera.photo
        by_photo[photo] = max(by_photo.get(photo, 0.0), seed.score)
    return min(1.0, sum(by_photo.values()) / max(len(facing), len(by_photo)) * candidate.fit)
