"""Looks: how a detector describes what may be an object, and which of it a text names.

They are made once after training and kept; then a word only compares descriptions. See docs/objects.md.
"""

from __future__ import annotations

import functools
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.special import expit, logit

from ..core.arrays import Float32, Float64, Floats, Int32, Int64, Mask, Pixels
from ..core.files import ArraySpec, keep_arrays, read_kept_arrays
from ..core.parts import part
from ..core.prefetch import prefetched
from ..core.system import usable_cores
from ..masks import box_ious, mask_box
from ..project.folder import stage_key
from .context import SegmentationContext
from .graph import LARGE
from .grounding import Detector
from .proposals import find_proposals
from .views import MIN_VISIBLE_PIXELS, View, spread_cameras
from .votes import MaskEvidence

_VERSION, _FILE = "looks 11", "looks.npz"

_CONTRAST = 0.8  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Weight of the mean log-odds of all proposals, which are subtracted: what all of the scene resembles says little."""

_USUAL_ODDS = -4.5  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Mean log-odds of a word and the proposals of a scene."""

_N_USUAL = 10
"""Proposals with the usual log-odds that the mean of a scene counts in addition: few proposals, which may all show the
object, say little about what all of the scene resembles."""

_LIKELY = 0.6  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8, more_rooms
"""Weight of the log-odds of being an object at all: of a whole and its parts, which look alike, the likelier one."""

_FALSE_ACCEPTS = 0.04  # chosen on museum_room, room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Largest share of the words of a vocabulary that a scene accepts, all of them taken for absent."""

_TAUGHT_ODDS = 3.1  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8, more_rooms
"""Log-odds that give a taught word a score of 0.5: examples have no vocabulary of absent words."""

_RIVALRY = 2.0  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Log-odds that a taught word loses for each by which a proposal looks more like another one."""

_CAUTION, _FEW_WORDS = 0.9, 10  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Log-odds that the only word that was taught needs in addition, and other words from which on it is half of that."""

_KNOWLEDGE, _MOST_KNOWN = 0.25, 4.0  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Weight of the log-odds of the vocabulary in those of a word that was taught as well, and their largest size."""

_KNOWN_CAUTION = 0.3  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Log-odds that a taught word which the vocabulary knows needs in addition: two may see in it what is absent."""

_SET_WEIGHT = 0.5  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Weight of the log-odds of the set in those of an object, to which how whole it looks is added."""

_MIN_BOX_IOU = 0.5
"""IoU from which on a box of a detector that describes no crops shows a proposal: the usual limit of detection."""

_MIN_SCORE = float(np.finfo(np.float16).eps)
"""Scores are clipped to this, of descriptions that are kept with 16 bits, and to one minus this: finite log-odds."""


@dataclass(frozen=True)
class Looks:
    """K proposals, and how a detector describes them in photos: S sightings.

    Attributes
    ----------
    members, like
        Those of `Proposals`; the sightings of ``like[k]`` describe proposal k.
    odds : array of shape [K], float32
        Log-odds of being an object: half of those of the set, and what the detector tells of how whole it looks. Those
        of the set alone for a detector that describes no crops.
    proposal : array of shape [S], int32
        Proposal of each sighting.
    photo : tuple of S str
        Photo of each sighting.
    box : array of shape [S, 2, 2], float32
        Corners x0, y0 and x1, y1 in the pixels of `Photos.pixels`.
    described : array of shape [S, D], float32
        By `Detector.describe_crops`; D is 0 for a detector that describes no crops.
    """

    members: Mask
    odds: Float32
    like: Int32
    proposal: Int32
    photo: tuple[str, ...]
    box: Float32
    described: Float32
    _least: dict[str, float] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Results of `least_odds`, by the name of the detector."""

    def scores(self, text: str, context: SegmentationContext) -> Float64:
        """Return how much each proposal looks like a text.

        A detector that describes crops scores proposals by `described_scores`. Any other one is asked for boxes in
        `n_text_views` photos. A proposal then scores 0 in a photo without a box that fits it, and more than 0.5 in
        others: the detector's own thresholds decide.

        Returns
        -------
        array of shape [K], float64
            0 to 1.

        Raises
        ------
        PromptError
            When the detector does not know the text.
        """
        if self.described.shape[1] > 0:
            return self.described_scores(text, context.detector)
        _, mean = _count_and_mean(self.proposal, self._boxed(text, context), self.like)
        return np.asarray(mean, np.float64)

    def described_scores(self, text: str, detector: Detector) -> Float64:
        """Return how much each proposal looks like a text by its descriptions, [K], 0 to 1.

        From 0.5 on, a proposal is what the text names: hardly any word of a vocabulary, few of which a scene shows,
        reaches that in this very scene (`least_odds`).

        Raises
        ------
        PromptError
            When the detector does not know the text.
        """
        return np.asarray(expit(self.odds_of(text, detector) - self.least_odds(detector)), np.float64)

    def scores_of_examples(self, taught: Float32, others: Float32, detector: Detector, text: str = "") -> Float64:
        """Return how much each proposal looks like the objects that taught a word, [K], 0 to 1.

        What looks more like the examples of another word is that: the nearest class mean wins. The fewer other words
        there are to be nearer, the more a proposal has to look like the word. From 0.5 on, it is what the word names.

        Parameters
        ----------
        taught : array of shape [1, E], float32
            Mean of the examples of the word, by `Detector.example_vectors`.
        others : array of shape [W, E], float32
            Means of those of each other word; W may be 0.
        text : str
            The word, if the detector knows it as well: what it tells is then added. Empty if it does not.
        """
        scores = detector.score_examples(self.described, np.concatenate([taught, others.reshape(-1, taught.shape[1])]))
        own, *rivals = (self._odds_by(one) for one in np.asarray(scores, np.float64).T)
        nearest, seen = np.maximum.reduce(rivals, initial=-np.inf), np.isfinite(own)
        odds = own - _RIVALRY * np.maximum(0, np.where(seen, nearest, 0) - np.where(seen, own, 0))
        odds = odds - _CAUTION * _FEW_WORDS / (_FEW_WORDS + len(others))
        if text:
            known = self.odds_of(text, detector) + _TAUGHT_ODDS - self.least_odds(detector)
            odds = odds + _KNOWLEDGE * np.clip(known, -_MOST_KNOWN, _MOST_KNOWN) - _KNOWN_CAUTION
        return np.asarray(expit(odds - _TAUGHT_ODDS), np.float64)

    def odds_of(self, text: str, detector: Detector) -> Float64:
        """Return the log-odds of each proposal for a text, [K], compared with `least_odds`; errors as above.

        Minus infinity for what no photo shows, and for all where no photo shows anything like the text.
        """
        return self._odds_by(detector.score_descriptions(self.described, text))

    def scores_of_unknown(self, text: str, detector: Detector) -> Float64 | None:
        """Return how much each proposal looks like a text that the detector does not know, [K], 0 to 1; None for no
        idea of it. Errors as of `Detector.score_unknown`."""
        scores = detector.score_unknown(self.described, text)
        return None if scores is None else np.asarray(expit(self._odds_by(scores) - self.least_odds(detector)))

    def _odds_by(self, scores: Sequence[float] | Float64) -> Float64:
        """Return the log-odds of each proposal by the scores of the S sightings."""
        count, mean = _count_and_mean(self.proposal, np.asarray(scores, np.float64), self.like)
        return self._odds(count, mean) if mean.any() else np.full(len(mean), -np.inf)

    def least_odds(self, detector: Detector) -> float:
        """Return the log-odds above which a proposal is what a word names, so that absent words are refused.

        Of the V words of `Detector.score_vocabulary`, floor(0.04 (V + 1)) - 1 have a proposal with larger odds. An
        absent word whose best odds are as likely to be the largest as those of each of these is therefore accepted with
        a probability of at most 0.04 (split conformal prediction), whatever the detector's scores mean. Words that the
        scene does show only lower it.
        """
        if detector.name not in self._least:
            self._least[detector.name] = self._find_least_odds(detector)
        return self._least[detector.name]

    def _find_least_odds(self, detector: Detector) -> float:
        scores = np.asarray(detector.score_vocabulary(self.described), np.float64)
        best = np.sort(
            [self._odds(*_count_and_mean(self.proposal, one, self.like)).max(initial=-np.inf) for one in scores.T]
        )
        rank = int(_FALSE_ACCEPTS * (len(best) + 1))
        # The next number: a word with the same odds is not accepted.
        return float(np.nextafter(best[-rank], np.inf)) if rank else float("inf")

    def _odds(self, count: Int64, mean: Float64) -> Float64:
        """Return the log-odds of proposals for a word by `_count_and_mean` of its scores, [K]."""
        odds = logit(np.clip(mean, _MIN_SCORE, 1 - _MIN_SCORE))
        described = odds[count > 0]
        resembled = (described.sum() + _N_USUAL * _USUAL_ODDS) / (len(described) + _N_USUAL)
        found = odds + _LIKELY * self.odds - _CONTRAST * resembled
        return np.asarray(np.where(count > 0, found, -np.inf), np.float64)

    def _boxed(self, text: str, context: SegmentationContext) -> Float64:
        """Return the score of each sighting by the detector's boxes; NaN in photos that are not searched."""
        cameras = [one for one in context.views.cameras.cameras if one.photo in set(self.photo)]
        rows = np.full(len(self.proposal), np.nan)
        for camera in spread_cameras(cameras, context.settings.n_text_views):
            numbers = np.flatnonzero(np.array(self.photo) == camera.photo)
            rows[numbers] = 0
            for found in context.detector.detect(context.photos.pixels(camera), text):
                overlaps = box_ious(self.box[numbers].reshape(len(numbers), -1), np.asarray(found.box, np.float32))
                fitting = numbers[overlaps >= _MIN_BOX_IOU]
                # Above `least_score`: the thresholds of the detector decided.
                rows[fitting] = np.maximum(rows[fitting], (1 + found.score) / 2)
        return rows

    def names(self, numbers: Sequence[int], context: SegmentationContext) -> list[tuple[str, float]]:
        """Return the detector's word for each proposal, with its confidence, 0 to 1; ("", 0) for one without words."""
        described = (self.described[self.proposal == k] for k in self.like[list(numbers)])
        return [next(iter(context.detector.name_descriptions(rows)), ("", 0.0)) for rows in described]

    def fitting_word(self, number: int, text: str, context: SegmentationContext) -> str:
        """Return the word that a proposal clearly is instead of a text; empty for none, see `Detector.fitting_word`."""
        rows = self.described[self.proposal == self.like[number]]
        return context.detector.fitting_word(rows, text) if rows.size else ""

    def evidence(self, number: int, score: float, context: SegmentationContext) -> MaskEvidence:
        """Return a proposal as evidence with this score, in the photo that shows it largest."""
        members, views = self.members[number], context.views
        sizes = np.where(self.proposal == self.like[number], np.prod(self.box[:, 1] - self.box[:, 0], axis=1), 0)
        view = views.of(views.cameras.by_photo[self.photo[int(sizes.argmax())]])
        return MaskEvidence(view, next(views.visible_masks(view, members[None])), score, members=members)

    def example(self, number: int, detector: Detector) -> Float32 | None:
        """Return what a proposal teaches as an example of a word, [E]; None where no photo describes it."""
        rows = self.described[self.proposal == self.like[number]]
        return detector.example_vectors(rows).mean(axis=0) if rows.size else None


def build_looks(context: SegmentationContext) -> Looks:
    """Return what may be an object, as the detector describes it in photos that show it large and whole.

    Raises
    ------
    Cancelled
        When the user stops.
    """
    with part("proposals"):
        sets = find_proposals(context.part(0, 2))
    context = context.part(1, 2)
    with part("describing proposals"):
        seen = _described(context, sets.members, sets.shown, np.unique(sets.like))
    odds = sets.odds
    if seen.rows.size:
        _, whole = _count_and_mean(seen.number, context.detector.whole_odds(seen.rows), sets.like)
        odds = (_SET_WEIGHT * odds + whole).astype(np.float32)
    return Looks(sets.members, odds, sets.like, seen.number, seen.photo, seen.box, seen.rows)


def describe_members(members: Mask, context: SegmentationContext) -> Float32:
    """Return how the detector describes an object in up to `n_crop_views` photos that show it large and whole.

    Parameters
    ----------
    members : array of shape [N], bool
        Its Gaussians.

    Returns
    -------
    array of shape [n, D], float32
        By `Detector.describe_crops`, rounded as those of a scene are kept; n is 0 for what no photo shows.

    Raises
    ------
    Cancelled
        When the user stops.
    """
    shown = context.graph.shown(csr_matrix(members[None], dtype=np.float32))
    return _described(context, members[None], shown, [0]).rows


class _Seen(NamedTuple):
    """S sightings of sets of Gaussians: number of the set, photo, corners in its pixels, and description."""

    number: Int32
    photo: tuple[str, ...]
    box: Float32
    rows: Float32


def _described(context: SegmentationContext, members: Mask, shown: Float32, numbers: Iterable[int]) -> _Seen:
    """Return the sightings of the sets `numbers` of `members`, [K, N], which have the pixels `shown`, [K, P]."""
    views, by_photo = context.views, context.views.cameras.by_photo
    sightings = _sightings(context, members, shown, numbers)
    found: list[tuple[int, str, tuple[int, int, int, int], bool]] = []
    described: list[Float32] = []

    def seen() -> Iterator[tuple[View, list[Mask]]]:
        for photo, sets in sightings.items():
            view = views.of(by_photo[photo])
            yield view, list(views.visible_masks(view, members[sets]))

    def cut(one: tuple[View, list[Mask]]) -> tuple[Pixels, list[tuple[Mask, tuple[int, int, int, int]] | None]]:
        view, masks = one
        pixels = context.photos.pixels(view.camera)
        return pixels, list(threads.map(functools.partial(_in_photo, view, pixels), masks))

    with ThreadPoolExecutor(len(usable_cores())) as threads:
        # Threads cut out what the next photo shows while this one is described.
        for done, (photo, (pixels, cuts)) in enumerate(zip(sightings, prefetched(cut, seen()), strict=True), 1):
            height, width = pixels.shape[:2]
            shown_here = [(number, *one) for number, one in zip(sightings[photo], cuts, strict=True) if one is not None]
            for number, _, box in shown_here:
                found.append((number, photo, box, min(box[:2]) > 0 and box[2] < width and box[3] < height))
            if shown_here:
                crops, boxes = [inside for _, inside, _ in shown_here], [box for _, _, box in shown_here]
                rows = context.detector.describe_crops(pixels, boxes, crops)
                described.append(np.zeros((len(crops), 0), np.float32) if rows is None else rows)
            context.tell(done / len(sightings), "Describing what may be objects")
    rows = (np.concatenate(described) if described else np.zeros((0, 1))).astype(np.float16)  # as they are kept
    numbered, whole = np.array([one[0] for one in found], np.int32), np.array([one[3] for one in found], bool)
    corners = np.array([one[2] for one in found], np.float32).reshape(-1, 2, 2)
    # Where a photo cuts off a set that others show whole, it is not described.
    kept = np.flatnonzero(whole | ~np.isin(numbered, numbered[whole]))
    return _Seen(numbered[kept], tuple(found[k][1] for k in kept), corners[kept], rows[kept].astype(np.float32))


def _in_photo(view: View, pixels: Pixels, mask: Mask) -> tuple[Mask, tuple[int, int, int, int]] | None:
    """Return a mask of a view in its photo, [H, W], and its box; None for one that is too small."""
    height, width = pixels.shape[:2]
    inside = cv2.resize(view.to_photo(mask).astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
    box = mask_box(inside)
    return None if mask.sum() < MIN_VISIBLE_PIXELS or box is None else (inside, box)


def _count_and_mean(proposal: Int32, values: Floats, like: Int32) -> tuple[Int64, Float64]:
    """Return how many `values` of sightings, without NaN, each of K proposals has, and their mean or 0, [K] both."""
    known = ~np.isnan(values)
    count = np.bincount(proposal[known], minlength=len(like))[like]
    return count, np.bincount(proposal[known], values[known], minlength=len(like))[like] / np.maximum(count, 1)


def _sightings(
    context: SegmentationContext, members: Mask, shown: Float32, numbers: Iterable[int]
) -> dict[str, list[int]]:
    """Return which sets to look at by photo: each in at most `n_crop_views` photos that show it large."""
    views = context.views
    cameras = [views.cameras.by_photo[photo] for photo in context.graph.photos]
    found: dict[str, list[int]] = defaultdict(list)
    for one in numbers:
        pixels = shown[one]
        facing = {camera.photo for camera in views.facing(np.median(context.means[members[one]], axis=0))}
        large = [camera for camera, area in zip(cameras, pixels, strict=True) if area >= LARGE * pixels.max()]
        seen = [camera for camera in large if camera.photo in facing] or large
        for camera in spread_cameras(seen, context.settings.n_crop_views):
            found[camera.photo].append(int(one))
    return found


_SPECS = {
    "members": ArraySpec("uint8", ("k", "bytes")),
    "odds": ArraySpec("float32", ("k",), finite=True),
    "like": ArraySpec("int32", ("k",)),
    "proposal": ArraySpec("int32", ("s",)),
    "photo": ArraySpec("str", ("s",)),
    "box": ArraySpec("float32", ("s", 2, 2), finite=True),
    "described": ArraySpec("float16", ("s", "d"), finite=True),
}


def load_or_build_looks(context: SegmentationContext) -> Looks:
    """Return the looks that were kept in memory or in the folder of the context, or make and keep them.

    A missing, damaged or outdated file is made again; one that cannot be written only costs time.

    Raises
    ------
    Cancelled
        When the user stops.
    """
    return context.once("looks", lambda: _load_or_build(context))


def kept_looks(context: SegmentationContext) -> Looks | None:
    """Return the looks of a scene that was looked at before; None where they would have to be made."""
    if "looks" in context.kept:
        return load_or_build_looks(context)
    file = None if context.folder is None else context.folder / _FILE
    looks = None if file is None or not file.is_file() else _read_kept(file, _recipe(context), context)
    return None if looks is None else context.once("looks", lambda: looks)


def _load_or_build(context: SegmentationContext) -> Looks:
    if context.folder is None:
        return build_looks(context)
    file, recipe = context.folder / _FILE, _recipe(context)
    looks = _read_kept(file, recipe, context)
    if looks is None:
        looks = build_looks(context)
        arrays = {name: np.asarray(getattr(looks, name)) for name in _SPECS}
        arrays |= {"members": np.packbits(looks.members, axis=1), "described": looks.described.astype(np.float16)}
        keep_arrays(file, recipe, arrays)
    return looks


def _recipe(context: SegmentationContext) -> str:
    settings = context.settings
    chosen = (settings.n_crop_views, settings.strictness, settings.photo_side)
    return stage_key(_VERSION, context.detector.name, context.graph.key, *chosen)


def _read_kept(file: Path, recipe: str, context: SegmentationContext) -> Looks | None:
    stored = read_kept_arrays(file, recipe, _SPECS)
    return None if stored is None else _from_arrays(stored, context)


def _from_arrays(arrays: dict[str, NDArray[Any]], context: SegmentationContext) -> Looks | None:
    """Return the looks; None when an array names what does not exist."""
    numbers = np.concatenate([arrays["proposal"], arrays["like"]])
    in_range = ((numbers >= 0) & (numbers < len(arrays["members"]))).all()
    if not in_range or not set(arrays["photo"].tolist()) <= set(context.graph.photos):
        return None
    read: dict[str, Any] = {
        **arrays,
        "members": np.unpackbits(arrays["members"], axis=1, count=len(context.means)).astype(bool),
        "described": arrays["described"].astype(np.float32),
        "photo": tuple(arrays["photo"].tolist()),
    }
    return Looks(**read)
