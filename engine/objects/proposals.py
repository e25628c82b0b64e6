"""Proposals: the objects that the segments of the photos suggest, what they look like, and which of them a text names.

They are made once after training and kept; then a word only compares descriptions. See docs/objects.md.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled
from ..events import Emit, Progress, StopCheck, part_of
from ..files import ArraySpec, keep_arrays, read_kept_arrays
from ..masks import box_ious, mask_box
from ..project_folder import stage_key
from ..scene import Camera
from .graph import SceneGraph, bounded
from .photos import Photos
from .settings import SegmentSettings
from .views import MAX_OBJECT_EXTENT, Views, spread_cameras
from .votes import THRESHOLD, MaskEvidence, Votes

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = ["GaussianSets", "Proposals", "build_proposals", "describe", "load_or_build_proposals"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]
Mask = NDArray[np.bool_]

_VERSION = 5  # by definition

_MIN_SEGMENT_SHARE = 0.001  # chosen on museum_room
"""Smallest segment that is a proposal, as a share of its photo."""

_MIN_COVERING = 0.35  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Covering (`SceneGraph.covering`) from which on a set of Gaussians is a proposal."""

_SAME_IOU = 0.8  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""IoU of the Gaussians above which two proposals are one: the one with the larger covering."""

_SOLVED_TOGETHER = 32  # by definition
"""Segments that are solved together. More need more memory and are hardly faster."""

_MIN_VISIBLE_PIXELS = 60  # chosen on museum_room
"""Smallest area of an object in a view's frame, in pixels. A smaller area does not show what the object is."""

_CONTRAST = 0.5  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Weight of the mean log-odds of all proposals, which are subtracted: what all of the scene resembles says little."""

_LEAST_ODDS = 1.75  # chosen on room_1, room_2, room_3, room_4, room_5, room_6, room_7, room_8
"""Log-odds, less the contrast, that give a score of 0.5. Of 80 absent words, 3 % score more."""

_MIN_SCORE = 1e-3  # by definition
"""Scores are clipped to this and to one minus this, so that their log-odds are finite."""


@dataclass(frozen=True)
class GaussianSets:
    """K sets of Gaussians that may be objects, in a scene with P photos in its graph.

    Attributes
    ----------
    members : bool array of shape [K, N]
    covering : array of shape [K], float32
        See `SceneGraph.covering`.
    shown : array of shape [K, P], float32
        Pixels that show each set in each photo.
    segment : int32 array of shape [K]
        Segment of the graph that the set was solved from; -1 for none.
    """

    members: Mask
    covering: Float32
    shown: Float32
    segment: Int32


@dataclass(frozen=True)
class Proposals:
    """K sets of Gaussians that may be objects, and how a detector describes them in photos: S sightings.

    Attributes
    ----------
    members : bool array of shape [K, N]
        In descending order of covering. They may overlap: a part and its whole are two proposals.
    covering : array of shape [K], float32
        See `SceneGraph.covering`.
    segment : int32 array of shape [K]
        Segment of the graph that the set was solved from; -1 for none.
    proposal : int32 array of shape [S]
        The proposal of each sighting.
    photo : tuple of S str
        The photo of each sighting.
    box : array of shape [S, 4], float32
        x0, y0, x1, y1 of the set in the pixels of `Photos.pixels`.
    described : array of shape [S, D], float32
        By `Detector.describe_crops`; D is 0 for a detector that describes no crops.
    """

    members: Mask
    covering: Float32
    segment: Int32
    proposal: Int32
    photo: tuple[str, ...]
    box: Float32
    described: Float32

    def scores(self, text: str, detector: Detector, views: Views, photos: Photos, n_photos: int) -> Float64:
        """Return how much each proposal looks like `text`, 0 to 1, shape [K].

        A detector that describes crops is calibrated: 0.5 is the score that 3 % of the absent words of the choosing
        rooms reach. Any other one is asked for boxes in `n_photos` photos. A proposal then scores 0 in a photo without
        a box that fits it, and more than 0.5 in others: the detector's own thresholds decide.

        Raises
        ------
        PromptError
            When the detector does not know the text.
        """
        known = np.ones(len(self.proposal), bool)
        if self.described.shape[1]:
            rows = np.asarray(detector.score_descriptions(self.described, text), np.float64)
        else:
            rows, known = self._boxed(text, detector, views, photos, n_photos)
        count = np.bincount(self.proposal[known], minlength=len(self.members))
        total = np.bincount(self.proposal[known], weights=rows[known], minlength=len(self.members))
        mean = total / np.maximum(count, 1)
        if not self.described.shape[1] or not mean.any():
            return np.asarray(mean, np.float64)
        clipped = np.clip(mean, _MIN_SCORE, 1 - _MIN_SCORE)
        odds = np.log(clipped / (1 - clipped))
        odds -= _CONTRAST * odds[count > 0].mean() + _LEAST_ODDS
        return np.where(count > 0, 1 / (1 + np.exp(-odds)), 0.0)

    def _boxed(
        self, text: str, detector: Detector, views: Views, photos: Photos, n_photos: int
    ) -> tuple[Float64, Mask]:
        """Return the score of each sighting by the detector's boxes, and which sightings are in searched photos."""
        searched = spread_cameras([one for one in views.cameras.cameras if one.photo in set(self.photo)], n_photos)
        rows, known = np.zeros(len(self.proposal)), np.zeros(len(self.proposal), bool)
        for camera in searched:
            numbers = np.flatnonzero(np.array(self.photo) == camera.photo)
            known[numbers] = True
            for found in detector.detect(photos.pixels(camera), text):
                overlaps = box_ious(self.box[numbers], np.asarray(found.box, np.float32))
                fitting = numbers[overlaps >= THRESHOLD]
                rows[fitting] = np.maximum(rows[fitting], (1 + found.score) / 2)
        return rows, known

    def names(self, detector: Detector) -> list[tuple[str, float]]:
        """Return the detector's word for each proposal, with its confidence 0 to 1; ("", 1) for one without words."""
        words = [detector.name_descriptions(self.described[self.proposal == k]) for k in range(len(self.members))]
        return [found[0] if found else ("", 1.0 if not self.described.shape[1] else 0.0) for found in words]

    def evidence(
        self, number: int, score: float, graph: SceneGraph, views: Views, label_maps: Mapping[str, Int32]
    ) -> MaskEvidence:
        """Return the segment that a proposal was solved from."""
        segment = self.segment[number]
        photo = graph.photos[graph.photo[segment]]
        view = views.of(views.cameras.by_photo[photo])
        return MaskEvidence(view, view.labels_from_photo(label_maps[photo]) == graph.label[segment], score)


def build_proposals(
    views: Views,
    graph: SceneGraph,
    photos: Photos,
    detector: Detector,
    settings: SegmentSettings,
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> Proposals:
    """Return the proposals of a scene: solved segments of several photos that the segments of all photos outline.

    Parameters
    ----------
    views : Views
    graph : SceneGraph
    photos : Photos
    detector : Detector
    settings : SegmentSettings
        `n_text_views`, `n_crop_views` and `strictness`.
    emit, should_stop
        See `engine.events`.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """
    segments, members = _solved(views, graph, settings, part_of(emit, 0, 2), should_stop)
    covering, shown = graph.covering(members)
    chosen: list[int] = []
    for k in np.argsort(-covering, kind="stable"):
        if covering[k] < _MIN_COVERING:
            break
        common = (members[chosen] & members[k]).sum(axis=1)
        union = members[chosen].sum(axis=1) + members[k].sum() - common
        if not (common > _SAME_IOU * union).any():
            chosen.append(int(k))
    sets = GaussianSets(members[chosen], covering[chosen], shown[chosen], np.array(segments, np.int32)[chosen])
    return describe(sets, views, graph, photos, detector, settings, emit=part_of(emit, 1, 2), should_stop=should_stop)


def describe(
    sets: GaussianSets,
    views: Views,
    graph: SceneGraph,
    photos: Photos,
    detector: Detector,
    settings: SegmentSettings,
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> Proposals:
    """Return sets of Gaussians as a detector describes them in photos that show them large and whole.

    The parameters and errors are those of `build_proposals`.
    """
    sightings = _sightings(views, sets, graph, settings.n_crop_views)
    by_photo = views.cameras.by_photo
    found: list[tuple[int, str, bool, Sequence[float]]] = []
    described: list[Float32] = []
    for done, (photo, numbers) in enumerate(sightings.items()):
        _check_stop(should_stop)
        view, pixels = views.of(by_photo[photo]), photos.pixels(by_photo[photo])
        size = (pixels.shape[1], pixels.shape[0])
        crops = []
        for number, mask in zip(numbers, views.visible_masks(view, sets.members[numbers]), strict=True):
            inside = cv2.resize(view.to_photo(mask).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
            box = mask_box(inside)
            if mask.sum() >= _MIN_VISIBLE_PIXELS and box is not None:
                crops.append((number, inside, [float(side) for side in box]))
        if crops:
            rows = detector.describe_crops(pixels, [box for *_, box in crops], [inside for _, inside, _ in crops])
            described.append(np.zeros((len(crops), 0), np.float32) if rows is None else rows)
            found += [(number, photo, _is_whole(inside), box) for number, inside, box in crops]
        emit(Progress("objects", (done + 1) / len(sightings), message="Describing what may be objects"))
    rows = np.concatenate(described).astype(np.float32) if described else np.zeros((0, 1), np.float32)
    seen_whole = {number for number, _, whole, _ in found if whole}
    kept = [k for k, (number, _, whole, _) in enumerate(found) if whole or number not in seen_whole]
    return Proposals(
        sets.members,
        sets.covering,
        sets.segment,
        np.array([found[k][0] for k in kept], np.int32),
        tuple(found[k][1] for k in kept),
        np.array([found[k][3] for k in kept], np.float32).reshape(-1, 4),
        rows[kept],
    )


def _is_whole(mask: Mask) -> bool:
    """Return whether a mask of a photo does not touch its border."""
    return not (mask[[0, -1]].any() or mask[:, [0, -1]].any())


def _check_stop(should_stop: StopCheck) -> None:
    if should_stop():
        raise Cancelled("Stopped while looking for what may be an object; no object was stored.")


def _solved(
    views: Views, graph: SceneGraph, settings: SegmentSettings, emit: Emit, should_stop: StopCheck
) -> tuple[list[int], Mask]:
    """Return segments of `n_text_views` photos, and the Gaussians that each of them leads to, bool [K, N]."""
    seeds = {camera.photo for camera in spread_cameras(_cameras_of(graph, views), settings.n_text_views)}
    columns = [k for k, photo in enumerate(graph.photo) if graph.photos[photo] in seeds and graph.label[k] > 0]
    segments: list[int] = []
    members: list[Mask] = []
    for start in range(0, len(columns), _SOLVED_TOGETHER):
        _check_stop(should_stop)
        part = columns[start : start + _SOLVED_TOGETHER]
        votes = [graph.votes_of(column) for column in part]
        together = Votes(np.stack([one.inside for one in votes], 1), np.stack([one.outside for one in votes], 1))
        for column, one, solved in zip(part, votes, graph.solve_each(together, settings.strictness).T, strict=True):
            shown = bounded(solved, views.scene.gaussians.means) >= THRESHOLD
            large = one.inside.sum() >= _MIN_SEGMENT_SHARE * (one.inside + one.outside).sum()
            if large and shown.any() and views.extent(shown) <= MAX_OBJECT_EXTENT:
                segments.append(column)
                members.append(shown)
        emit(Progress("objects", (start + len(part)) / len(columns), message="Looking for objects"))
    return segments, np.array(members, bool).reshape(len(members), len(views.scene))


def _cameras_of(graph: SceneGraph, views: Views) -> list[Camera]:
    """Return the cameras of the photos of the graph, in its order."""
    by_photo = views.cameras.by_photo
    return [by_photo[photo] for photo in graph.photos]


def _sightings(views: Views, sets: GaussianSets, graph: SceneGraph, count: int) -> dict[str, list[int]]:
    """Return the sets to look at by photo: each in at most `count` photos that show it large, from all sides."""
    cameras = _cameras_of(graph, views)
    found: dict[str, list[int]] = defaultdict(list)
    for number, (members, pixels) in enumerate(zip(sets.members, sets.shown, strict=True)):
        if not members.any():
            continue
        center = np.median(views.scene.gaussians.means[members], axis=0)
        facing = {camera.photo for camera in views.facing(center)}
        large = [camera for camera, area in zip(cameras, pixels, strict=True) if area >= THRESHOLD * pixels.max()]
        for camera in spread_cameras([one for one in large if one.photo in facing] or large, count):
            found[camera.photo].append(number)
    return found


_SPECS = {
    "covering": ArraySpec("float32", ("k",), finite=True),
    "segment": ArraySpec("int32", ("k",)),
    "proposal": ArraySpec("int32", ("s",)),
    "photo": ArraySpec("str", ("s",)),
    "box": ArraySpec("float32", ("s", 4), finite=True),
    "described": ArraySpec("float16", ("s", "d"), finite=True),
}  # by definition


def load_or_build_proposals(
    file: Path,
    views: Views,
    graph: SceneGraph,
    photos: Photos,
    detector: Detector,
    settings: SegmentSettings,
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> Proposals:
    """Return the proposals stored in `file`, or make and store them; parameters and errors as of `build_proposals`.

    A missing, damaged or outdated file is made again; a file that cannot be written only costs time.
    """
    chosen = (settings.n_text_views, settings.n_crop_views, settings.strictness, settings.photo_side)
    recipe = stage_key(_VERSION, detector.name, graph.key, *chosen)
    specs = {"members": ArraySpec("uint8", ("k", (len(views.scene) + 7) // 8)), **_SPECS}
    stored = read_kept_arrays(file, recipe, specs)
    known = None if stored is None else _from_arrays(stored, views, graph)
    if known is not None:
        return known
    proposals = build_proposals(views, graph, photos, detector, settings, emit=emit, should_stop=should_stop)
    arrays: dict[str, NDArray[Any]] = {name: np.asarray(getattr(proposals, name)) for name in _SPECS}
    arrays |= {
        "members": np.packbits(proposals.members, axis=1),
        "photo": np.array(proposals.photo, dtype=np.str_),
        "described": proposals.described.astype(np.float16),
    }
    keep_arrays(file, recipe, arrays)
    return proposals


def _from_arrays(arrays: dict[str, NDArray[Any]], views: Views, graph: SceneGraph) -> Proposals | None:
    """Return the proposals; None when an array names what does not exist."""
    in_range = (
        ((arrays["proposal"] >= 0) & (arrays["proposal"] < len(arrays["members"]))).all()
        and ((arrays["segment"] >= 0) & (arrays["segment"] < len(graph.photo))).all()
        and set(arrays["photo"].tolist()) <= set(graph.photos)
    )
    if not in_range:
        return None
    return Proposals(
        members=np.unpackbits(arrays["members"], axis=1, count=len(views.scene)).astype(bool),
        photo=tuple(str(name) for name in arrays["photo"]),
        described=arrays["described"].astype(np.float32),
        **{name: arrays[name] for name in ("covering", "segment", "proposal", "box")},
    )
