"""Every object of a scene without a prompt: groups told apart from their surroundings, and names suggested for them."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled, PromptError
from ..events import Emit, Progress, StopCheck, part_of
from ..project_folder import ProjectFolder
from .candidates import THRESHOLD, crop_of, overlap
from .clustering import cluster_scene, vote_for_groups
from .context import SegmentationContext, load_context
from .curation import memberships_of, store_background
from .evidence import DetectorFactory
from .found import record_of
from .growing import Levels
from .photos import SamFactory
from .polishing import polish_each
from .settings import SegmentSettings
from .storage import ObjectRecord, save_object
from .views import LARGEST, Views, spread_cameras

__all__ = ["DetectedObject", "find_everything", "segment_everything_in"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_N_VIEWS = 16
_FEWEST = 60
_NAMED = 0.5
"""Confidence from which on a name is suggested."""

_MERGED = 1.05
"""Two groups that touch are one object when the detector is surer of both together, by this factor, than of either."""


@dataclass(frozen=True)
class DetectedObject:
    """An object that nobody asked for.

    Attributes
    ----------
    membership : array of shape [N], float32
        In [0, 1].
    name : str
        What the detector takes it for; empty when it is not sure.
    score : float
        How sure it is, 0 to 1.
    groups : tuple of int
        Of `engine.objects.clustering`, that it is made of.
    """

    membership: Float32
    name: str
    score: float
    groups: tuple[int, ...]

    @property
    def members(self) -> Mask:
        """Gaussians that belong, bool [N]."""
        return self.membership >= THRESHOLD


def find_everything(
    trained: SegmentationContext,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
) -> list[DetectedObject]:
    """Return the objects of a scene without its background, the surest first; none of them overlap.

    Parameters
    ----------
    trained : SegmentationContext
    settings : SegmentSettings
        `n_crop_views`.
    detector_factory : callable
    emit, should_stop
        See `engine.events`.

    Raises
    ------
    Cancelled
        When `should_stop` says so.

    Notes
    -----
    Background is what is longer than 1.2 times the cameras' spread (walls, floor, tables), and what carries another
    group: a plinth is told from the exhibit on it by lying below it within the same outline, seen from above.
    """
    views = trained.views
    emit(Progress("objects", 0.0, message="Grouping the Gaussians"))
    labels = cluster_scene(views)
    if labels.max() < 0:
        return []
    votes, pictures = vote_for_groups(views, labels, trained.label_maps, n_views=_N_VIEWS, should_stop=should_stop)
    emit(Progress("objects", 0.6, message="Telling objects from their surroundings"))
    sight = _GroupNamer(trained, votes, pictures, detector_factory, settings)
    groups = [k for k in range(votes.shape[1]) if (votes[:, k] >= THRESHOLD).sum() >= _FEWEST]
    objects = _without_background(views, votes, groups)
    named: list[DetectedObject] = []
    for number, group in enumerate(objects):
        if should_stop():
            raise Cancelled("Stopped while looking at all objects; none was stored.")
        named.append(sight.named((group,)))
        emit(Progress("objects", 0.6 + 0.3 * (number + 1) / len(objects), message="Naming"))
    return sorted(_merged(sight, named, should_stop), key=lambda one: -one.score)


class _GroupNamer:
    """What the voting views saw of each group."""

    def __init__(
        self,
        trained: SegmentationContext,
        votes: Float32,
        pictures: Sequence[tuple[str, NDArray[np.int32]]],
        detector_factory: DetectorFactory,
        settings: SegmentSettings,
    ) -> None:
        self.trained, self._votes, self._pictures = trained, votes, pictures
        self._detector_factory, self._settings = detector_factory, settings

    def named(self, groups: tuple[int, ...]) -> DetectedObject:
        """Return the groups as one object, with the name that the detector suggests from several sides."""
        membership = self._votes[:, list(groups)].max(axis=1)
        suggestions = self._detector_factory().name_crops(list(self._crops(groups)))
        if not suggestions:
            return DetectedObject(membership, "", 0.0, groups)
        name, score = suggestions[0]
        return DetectedObject(membership, name if score >= _NAMED else "", score, groups)

    def _crops(self, groups: tuple[int, ...]) -> Iterator[tuple[NDArray[np.uint8], list[int], Mask]]:
        views, photos = self.trained.views, self.trained.photos
        masks = {photo: np.isin(picture, groups) for photo, picture in self._pictures}
        large = [camera for camera in views.cameras.cameras if camera.photo in masks]
        large = [camera for camera in large if masks[camera.photo].sum() >= _FEWEST]
        for camera in spread_cameras(large, self._settings.n_crop_views):
            crop = crop_of(views.of(camera), masks[camera.photo], photos)
            if crop is not None:
                yield crop


def _without_background(views: Views, votes: Float32, groups: Sequence[int]) -> list[int]:
    means = views.scene.gaussians.means
    unit = views.cameras_spread
    boxes = [np.percentile(means[votes[:, group] >= THRESHOLD], [5, 95], axis=0) for group in groups]
    small = [i for i, box in enumerate(boxes) if (box[1] - box[0]).max() <= LARGEST * unit]
    return [groups[i] for i in small if not any(_carries(boxes[i], boxes[k]) for k in small if k != i)]


def _carries(lower: NDArray[np.floating], upper: NDArray[np.floating]) -> bool:
    """Return whether the box `upper`, [2, 3], stands on `lower`: within its outline, and its foot at its top."""
    height = lower[1, 2] - lower[0, 2]
    foot = abs(upper[0, 2] - lower[1, 2]) <= 0.35 * height + 0.2 * (upper[1, 2] - upper[0, 2])
    middle = upper[:, :2].mean(axis=0)
    within = ((middle >= lower[0, :2]) & (middle <= lower[1, :2])).all()
    narrower = np.prod(upper[1, :2] - upper[0, :2]) <= 1.2 * np.prod(lower[1, :2] - lower[0, :2])
    above = upper[:, 2].mean() > lower[1, 2]
    return bool(foot and within and narrower and above)


def _merged(sight: _GroupNamer, named: Sequence[DetectedObject], should_stop: StopCheck) -> list[DetectedObject]:
    """Return the objects with those put together that are one: a bell and the yoke it hangs from."""
    left = list(named)
    tried: set[tuple[int, ...]] = set()
    while True:
        pairs = ((one, other) for i, one in enumerate(left) for other in left[i + 1 :])
        pair = next(
            (
                (one, other)
                for one, other in pairs
                if (*one.groups, *other.groups) not in tried and _touch(sight.trained.views, one.members, other.members)
            ),
            None,
        )
        if pair is None:
            return left
        if should_stop():
            raise Cancelled("Stopped while looking at all objects; none was stored.")
        one, other = pair
        together = (*one.groups, *other.groups)
        tried.add(together)
        both = sight.named(together)
        if both.name and both.score > _MERGED * max(one.score, other.score):
            left = [item for item in left if item is not one and item is not other] + [both]


def _touch(views: Views, one: Mask, other: Mask) -> bool:
    from scipy.spatial import cKDTree

    means = views.scene.gaussians.means
    a, b = means[one], means[other]
    a, b = (a, b) if len(a) < len(b) else (b, a)
    usual = float(np.median(cKDTree(a).query(a, k=min(4, len(a)))[0][:, -1]))
    near = cKDTree(b).query(a, distance_upper_bound=2 * usual)[0]
    return bool(np.isfinite(near).mean() > 0.03)


def segment_everything_in(
    project: ProjectFolder,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    sam_factory: SamFactory,
    emit: Emit,
    should_stop: StopCheck,
) -> tuple[list[ObjectRecord], list[str], ObjectRecord]:
    """Store every object of a trained project that is not there yet, and the background.

    Parameters
    ----------
    project : ProjectFolder
        SegmentationContext, and held for writing.
    settings, detector_factory, sam_factory, emit, should_stop
        As in `engine.objects.segment.segment_project`.

    Returns
    -------
    list of ObjectRecord
        Those stored now, the surest first.
    list of str
        Ids of the objects that were there and were found again; they stay as they are.
    ObjectRecord
        The background.

    Raises
    ------
    PromptError
        When there is nothing but background.
    HeritageError
        When a part of the project is missing or damaged.
    """
    started = time.perf_counter()
    trained = load_context(project, settings, sam_factory)
    found = find_everything(
        trained, settings, detector_factory=detector_factory, emit=part_of(emit, 0, 2), should_stop=should_stop
    )
    there = memberships_of(project.path, len(trained.views.scene))
    if not found and not there:
        raise PromptError("Nothing stands out from the background of this scene. Click on an object instead.")
    same = [
        [key for key, other in there.items() if overlap(item.membership, other) > settings.same_object]
        for item in found
    ]
    new = [(number, item) for number, (item, others) in enumerate(zip(found, same, strict=True), 1) if not others]
    each = polish_each(
        trained.views, [item.members for _, item in new], settings, emit=part_of(emit, 1, 2), should_stop=should_stop
    )
    made: list[ObjectRecord] = []
    for (number, item), polished in zip(new, each, strict=True):
        record = record_of(
            project.path,
            Levels((item.membership,)),
            {"kind": "all"},
            item.name or f"object {number}",
            settings,
            started,
            score=item.score if item.name else 0.0,
            fit=1.0,
        )
        save_object(project.path, record, item.membership, polished=polished)
        made.append(record)
    background = store_background(project, settings)
    emit(Progress("objects", 1.0, message="Isolating"))
    return made, list(dict.fromkeys(key for others in same for key in others)), background
