"""Segmentation of all objects of a scene without a prompt, with names suggested by the detector."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled, PromptError
from ..events import Emit, Progress, StopCheck, part_of
from ..project_folder import ProjectFolder
from ..rasterizer import PROCESSOR, Device
from ..records import ObjectRecord
from .candidates import THRESHOLD, overlap
from .clustering import cluster_scene, vote_for_groups
from .context import SegmentationContext, load_context
from .crops import crop_photo
from .curation import memberships_of, store_background
from .evidence import DetectorFactory
from .found import ObjectRequest, new_record
from .levels import Levels
from .photos import SamFactory
from .polishing import polish_each
from .selection import without_far
from .settings import SegmentSettings
from .storage import save_object
from .views import MAX_OBJECT_EXTENT, Views, spread_cameras

__all__ = ["DetectedObject", "find_everything", "segment_everything_in"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_N_VIEWS = 16  # chosen on museum_room
"""Views that vote on the groups."""

_MIN_SIZE = 60  # chosen on museum_room
"""Smallest object in Gaussians, and smallest area of an object in a view in pixels."""

_MIN_NAME_SCORE = 0.5  # chosen on museum_room
"""Score of the detector from which on a name is suggested."""

_MIN_MERGE_GAIN = 1.05  # chosen on museum_room
"""Two touching groups are merged if their score together exceeds the better of their own scores by this factor."""

_MIN_TOUCHING_SHARE = 0.03  # chosen on museum_room
"""Share of the smaller group's Gaussians with a Gaussian of the other group nearby from which on the two touch."""

_MAX_GAP_BELOW, _MAX_GAP_ABOVE = 0.35, 0.2  # chosen on museum_room
"""Largest distance between the top of a support and what rests on it: shares of the heights of the two, added."""

_MAX_OVERHANG = 1.2  # chosen on museum_room
"""Largest outline of what rests on a support, relative to the support's."""


@dataclass(frozen=True)
class DetectedObject:
    """An object found without a prompt.

    Attributes
    ----------
    membership : array of shape [N], float32
        In [0, 1].
    name : str
        Name suggested by the detector; empty below `_MIN_NAME_SCORE`.
    score : float
        Score of the detector, 0 to 1.
    groups : tuple of int
        Groups of `engine.objects.clustering` that the object consists of.
    """

    membership: Float32
    name: str
    score: float
    groups: tuple[int, ...]

    @property
    def members(self) -> Mask:
        """Gaussians that belong to the object, bool [N]."""
        return self.membership >= THRESHOLD


def find_everything(
    context: SegmentationContext,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    emit: Emit,
    should_stop: StopCheck,
) -> list[DetectedObject]:
    """Return the objects of a scene without its background, in descending order of score; no two overlap.

    Parameters
    ----------
    context : SegmentationContext
    settings : SegmentSettings
        Uses `n_crop_views`.
    detector_factory : callable
    emit, should_stop
        See `engine.events`.

    Returns
    -------
    list of DetectedObject

    Raises
    ------
    Cancelled
        When `should_stop` returns True.

    Notes
    -----
    A group is background if it is longer than `MAX_OBJECT_EXTENT` (walls, floors, tables) or supports another group: a
    plinth is below the exhibit, which is within its outline seen from above.
    """
    views = context.views
    emit(Progress("objects", 0.0, message="Grouping the Gaussians"))
    labels = cluster_scene(views)
    if labels.max() < 0:
        return []
    votes, pictures = vote_for_groups(views, labels, context.label_maps, n_views=_N_VIEWS, should_stop=should_stop)
    emit(Progress("objects", 0.6, message="Separating objects from the background"))
    namer = _GroupNamer(context, votes, pictures, detector_factory, settings)
    groups = [k for k in range(votes.shape[1]) if (votes[:, k] >= THRESHOLD).sum() >= _MIN_SIZE]
    groups = _without_background(views, votes, groups)
    objects: list[DetectedObject] = []
    for number, group in enumerate(groups):
        if should_stop():
            raise Cancelled("Stopped while searching for all objects; none was stored.")
        objects.append(namer.name((group,)))
        emit(Progress("objects", 0.6 + 0.3 * (number + 1) / len(groups), message="Naming"))
    return sorted(_merged(namer, objects, should_stop), key=lambda item: -item.score)


class _GroupNamer:
    """Suggests a name for groups from crops of the photos that voted on them."""

    def __init__(
        self,
        context: SegmentationContext,
        votes: Float32,
        pictures: Sequence[tuple[str, NDArray[np.int32]]],
        detector_factory: DetectorFactory,
        settings: SegmentSettings,
    ) -> None:
        self.context, self._votes, self._pictures = context, votes, pictures
        self._detector_factory, self._settings = detector_factory, settings

    def name(self, groups: tuple[int, ...]) -> DetectedObject:
        """Return the groups as one object with the name that the detector suggests from several views."""
        votes = self._votes[:, list(groups)].max(axis=1)
        membership = without_far(self.context.views.scene.gaussians.means, votes, votes >= THRESHOLD)
        suggestions = self._detector_factory().name_crops(list(self._crops(groups)))
        if not suggestions:
            return DetectedObject(membership, "", 0.0, groups)
        name, score = suggestions[0]
        return DetectedObject(membership, name if score >= _MIN_NAME_SCORE else "", score, groups)

    def _crops(self, groups: tuple[int, ...]) -> Iterator[tuple[NDArray[np.uint8], list[int], Mask]]:
        views, photos = self.context.views, self.context.photos
        masks = {photo: np.isin(picture, groups) for photo, picture in self._pictures}
        cameras = [camera for camera in views.cameras.cameras if camera.photo in masks]
        cameras = [camera for camera in cameras if masks[camera.photo].sum() >= _MIN_SIZE]
        for camera in spread_cameras(cameras, self._settings.n_crop_views):
            crop = crop_photo(views.of(camera), masks[camera.photo], photos)
            if crop is not None:
                yield crop


def _without_background(views: Views, votes: Float32, groups: Sequence[int]) -> list[int]:
    means = views.scene.gaussians.means
    unit = views.cameras_spread
    boxes = [np.percentile(means[votes[:, group] >= THRESHOLD], [5, 95], axis=0) for group in groups]
    small = [i for i, box in enumerate(boxes) if (box[1] - box[0]).max() <= MAX_OBJECT_EXTENT * unit]
    return [groups[i] for i in small if not any(_supports(boxes[i], boxes[k]) for k in small if k != i)]


def _supports(lower: NDArray[np.floating], upper: NDArray[np.floating]) -> bool:
    """Return whether `upper` rests on `lower`, boxes [2, 3]: it is within its outline and starts near its top."""
    height = lower[1, 2] - lower[0, 2]
    meets = abs(upper[0, 2] - lower[1, 2]) <= _MAX_GAP_BELOW * height + _MAX_GAP_ABOVE * (upper[1, 2] - upper[0, 2])
    center = upper[:, :2].mean(axis=0)
    within = ((center >= lower[0, :2]) & (center <= lower[1, :2])).all()
    narrower = np.prod(upper[1, :2] - upper[0, :2]) <= _MAX_OVERHANG * np.prod(lower[1, :2] - lower[0, :2])
    above = upper[:, 2].mean() > lower[1, 2]
    return bool(meets and within and narrower and above)


def _merged(namer: _GroupNamer, objects: Sequence[DetectedObject], should_stop: StopCheck) -> list[DetectedObject]:
    """Merge touching objects that the detector scores higher together, e.g. a bell and its yoke."""
    objects = list(objects)
    tried: set[tuple[int, ...]] = set()
    while True:
        pairs = ((first, second) for i, first in enumerate(objects) for second in objects[i + 1 :])
        pair = next(
            (
                (first, second)
                for first, second in pairs
                if (*first.groups, *second.groups) not in tried
                and _touch(namer.context.views, first.members, second.members)
            ),
            None,
        )
        if pair is None:
            return objects
        if should_stop():
            raise Cancelled("Stopped while searching for all objects; none was stored.")
        first, second = pair
        groups = (*first.groups, *second.groups)
        tried.add(groups)
        merged = namer.name(groups)
        if merged.name and merged.score > _MIN_MERGE_GAIN * max(first.score, second.score):
            objects = [item for item in objects if item is not first and item is not second] + [merged]


def _touch(views: Views, first: Mask, second: Mask) -> bool:
    from scipy.spatial import cKDTree

    means = views.scene.gaussians.means
    a, b = means[first], means[second]
    a, b = (a, b) if len(a) < len(b) else (b, a)
    spacing = float(np.median(cKDTree(a).query(a, k=min(4, len(a)))[0][:, -1]))
    near = cKDTree(b).query(a, distance_upper_bound=2 * spacing)[0]
    return bool(np.isfinite(near).mean() > _MIN_TOUCHING_SHARE)


def segment_everything_in(
    project: ProjectFolder,
    settings: SegmentSettings,
    *,
    detector_factory: DetectorFactory,
    sam_factory: SamFactory,
    emit: Emit,
    should_stop: StopCheck,
    device: Device = PROCESSOR,
) -> tuple[list[ObjectRecord], list[str], ObjectRecord]:
    """Store every object of a trained project that is not stored yet, and the background.

    Parameters
    ----------
    project : ProjectFolder
        A trained project, open for writing.
    settings, detector_factory, sam_factory, emit, should_stop, device
        As in `engine.objects.segment.segment_project`.

    Returns
    -------
    list of ObjectRecord
        The new objects, in descending order of score.
    list of str
        Ids of existing objects that were found again. They stay unchanged.
    ObjectRecord
        The background.

    Raises
    ------
    PromptError
        If the scene contains nothing but background.
    HeritageError
        If a part of the project is missing or damaged.
    """
    started = time.perf_counter()
    context = load_context(project, settings, sam_factory, device=device, emit=emit)
    found = find_everything(
        context, settings, detector_factory=detector_factory, emit=part_of(emit, 0, 2), should_stop=should_stop
    )
    existing = memberships_of(project.path, len(context.views.scene))
    if not found and not existing:
        raise PromptError("No object was found in front of the background of this scene. Click on an object instead.")
    same = [
        [key for key, other in existing.items() if overlap(item.membership, other) > settings.same_object]
        for item in found
    ]
    new = [(number, item) for number, (item, keys) in enumerate(zip(found, same, strict=True), 1) if not keys]
    each = polish_each(
        context.views, [item.members for _, item in new], settings, emit=part_of(emit, 1, 2), should_stop=should_stop
    )
    records: list[ObjectRecord] = []
    for (number, item), polished in zip(new, each, strict=True):
        record = new_record(
            project.path,
            Levels((item.membership,)),
            ObjectRequest({"kind": "all"}, item.name or f"object {number}", settings, started),
            score=item.score if item.name else 0.0,
            fit=1.0,
        )
        save_object(project.path, record, item.membership, polished=polished)
        records.append(record)
    background = store_background(project, settings)
    emit(Progress("objects", 1.0, message="Isolating"))
    return records, list(dict.fromkeys(key for keys in same for key in keys)), background
