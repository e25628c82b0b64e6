"""Levels of an object, from part to whole: nested memberships from SAM's masks, support planes and features.

See docs/design_notes/objects.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..cameras import project
from ..errors import Cancelled
from ..events import StopCheck
from ..masks import mask_iou
from ..scene import FEATURE_DIM, Camera
from .context import SegmentationContext
from .hierarchy import Hierarchy
from .lifting import Lifted, refine_by_votes
from .selection import BELOW_HALF, HALF, connected_parts, with_members, without_far
from .settings import SegmentSettings
from .support_plane import SupportedVersion, cut_at_support_planes
from .views import Views, spread_cameras
from .voting import VoteCount

__all__ = ["Levels", "find_levels"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]
Box = tuple[float, float, float, float]
Scorer = Callable[[Mask], float]

_BOX_EXTENSIONS = (0.35, 0.7, 1.2, 2.0)  # chosen on museum_room
"""Distances by which SAM's box is extended below the object, in heights of the object.

The part that SAM leaves out is mostly the base: pictures and features merge it with the support. In a box of its own
SAM separates the two.
"""

_MIN_COVER = 0.85  # chosen on museum_room
"""Share of an object that a larger level must contain. A box that SAM fills with something else gives no level."""

_MAX_SIZE = 6.0  # chosen on museum_room
"""Largest number of Gaussians in a level, relative to the object."""

_MIN_SCORE_WITH_BASE = 0.97  # chosen on museum_room, store_room
"""Score of a version with more of a base, relative to the object's, from which on it is chosen.

A base hardly raises an object's similarity to its name. Of several such versions the one of median size is chosen,
because the cuts of the groups around an object scatter about its end.
"""

SAME_LEVEL_IOU = 0.9  # chosen on museum_room
"""IoU above which two levels are the same."""

_MIN_OUTLINES = 3  # chosen on museum_room
"""Smallest number of outlines that can remove a part of the object."""

_MIN_OUTSIDE_SHARE = 0.05  # chosen on museum_room
"""Smallest share of an object outside of all outlines that is removed. Less may be due to imprecise edges."""

_MIN_BOX_IN_PHOTO = 0.8  # chosen on museum_room
"""Share of a box that must be within the photo."""

_MIN_BOX_SIDE = 4  # by definition
"""Smallest side of a box in pixels of the photo."""

_MIN_VIEWS = 3  # chosen on museum_room
"""Smallest number of views that can vote on a level."""


@dataclass(frozen=True)
class _Version:
    """A membership, its score, and the cut at a support plane that made it, if any."""

    membership: Float32
    score: float
    cut: SupportedVersion | None = None


@dataclass(frozen=True)
class Levels:
    """Memberships from part to whole, each contained in the next.

    Attributes
    ----------
    memberships : tuple of arrays of shape [N], float32
        At least one.
    chosen : int
        Index of the level that becomes the object unless the user chooses another one.
    """

    memberships: tuple[Float32, ...]
    chosen: int = 0  # by definition

    @property
    def membership(self) -> Float32:
        """The chosen level."""
        return self.memberships[self.chosen]


def find_levels(
    context: SegmentationContext,
    membership: Float32,
    directions: Float32,
    settings: SegmentSettings,
    *,
    scorer: Scorer | None,
    hierarchy: Hierarchy | None,
    should_stop: StopCheck,
) -> Levels:
    """Return an object with smaller and larger versions of it.

    Parameters
    ----------
    context : SegmentationContext
        Photos with a label map are preferred if there are enough of them, because SAM has encoded them already.
    membership : array of shape [N], float32
        The object.
    directions : array of shape [K, D], float32
        Directions of the object in feature space, the main one first. The members similar to the main one are a part.
    settings : SegmentSettings
        Uses `n_level_views`, `level_gain` and `cosine`.
    scorer : callable or None
        Returns the similarity of members, bool [N], to the prompt, 0 to 1. With it, the level with the best score is
        chosen, otherwise the object as given.
    hierarchy : Hierarchy or None
        Groups of the scene. With them and a scorer, the object and the groups around it are also cut at their support
        planes (`cut_at_support_planes`).
    should_stop : callable

    Returns
    -------
    Levels

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """
    given = membership
    outlines = _outlines(context, membership, settings, should_stop)
    membership = _without_outside(membership, outlines)
    larger = _distinct(outlines)
    scales = _voted(context, membership, membership, settings, should_stop, scales=True)
    larger += [scale for scale in scales if _is_level(scale, membership)]
    chosen = membership
    if scorer is not None:
        chosen, refined = _choose(
            context, membership, larger, settings, should_stop, scorer=scorer, hierarchy=hierarchy
        )
        larger += refined
    parts = _parts(context.views, chosen, directions, settings)
    levels = _nested(chosen, [membership, given, *larger, *scales, *parts])
    means = context.views.scene.gaussians.means
    return replace(levels, memberships=tuple(without_far(means, level, level >= HALF) for level in levels.memberships))


def _outlines(
    context: SegmentationContext, membership: Float32, settings: SegmentSettings, should_stop: StopCheck
) -> list[Float32]:
    """Return SAM's outlines in boxes that extend further and further down, if they contain the object."""
    return [
        outline
        for extension in _BOX_EXTENSIONS
        for outline in _voted(context, membership, membership, settings, should_stop, extension=extension)
        if _is_level(outline, membership)
    ]


def _distinct(outlines: Sequence[Float32]) -> list[Float32]:
    distinct: list[Float32] = []
    for outline in outlines:
        if not any(_iou(outline, kept) > SAME_LEVEL_IOU for kept in distinct):
            distinct.append(outline)
    return distinct


def _without_outside(membership: Float32, outlines: Sequence[Float32]) -> Float32:
    """Return the membership without the Gaussians outside of all outlines, if all outlines are nearly the same.

    Features and segments may join a shield with the picture frame that it touches.
    """
    same = all(_iou(outline, other) > SAME_LEVEL_IOU for i, outline in enumerate(outlines) for other in outlines[:i])
    if len(outlines) < _MIN_OUTLINES or not same:
        return membership
    members = membership >= HALF
    outside = members & ~(np.maximum.reduce(list(outlines)) >= HALF)
    if outside.sum() < _MIN_OUTSIDE_SHARE * members.sum():
        return membership
    return with_members(membership, members & ~outside)


def _choose(
    context: SegmentationContext,
    membership: Float32,
    larger: Sequence[Float32],
    settings: SegmentSettings,
    should_stop: StopCheck,
    *,
    scorer: Scorer,
    hierarchy: Hierarchy | None,
) -> tuple[Float32, list[Float32]]:
    """Return the version that `scorer` prefers, and SAM's outlines of the best version in its own box."""
    versions = [_Version(level, scorer(level >= HALF)) for level in larger]
    if hierarchy is not None:
        cuts = cut_at_support_planes(context.views.scene.gaussians.means, membership, hierarchy)
        versions += [_Version(cut.membership, scorer(cut.membership >= HALF), cut) for cut in cuts]
    if not versions:
        return membership, []
    best = max(versions, key=lambda version: version.score)
    # In the best version's own box, SAM's answer no longer depends on how far the first box extended.
    core = np.minimum(membership, best.membership)
    outlines = _voted(context, best.membership, core, settings, should_stop)
    refined = [outline for outline in outlines if _is_level(outline, core)]
    versions += [_Version(outline, scorer(outline >= HALF)) for outline in refined]
    score = scorer(membership >= HALF)
    better = [version for version in versions if version.score > settings.level_gain * score]
    with_base = [
        version
        for version in versions
        if version.cut and version.cut.adds_base and version.score >= _MIN_SCORE_WITH_BASE * score
    ]
    if better:
        best = max(better, key=lambda version: version.score)
    elif with_base:
        by_size = sorted(with_base, key=lambda version: int((version.membership >= HALF).sum()))
        best = by_size[(len(by_size) - 1) // 2]
    else:
        return membership, refined
    if best.cut:
        return _refined_cut(context.views, best.membership, settings, should_stop), refined
    return best.membership, refined


def _refined_cut(views: Views, membership: Float32, settings: SegmentSettings, should_stop: StopCheck) -> Float32:
    """Return a version that was cut at a height with the outline that it has in the views.

    SAM's segments are not used, because they may end above the base like the features.
    """
    no_weights = np.zeros_like(membership)
    cut = Lifted(np.zeros((0, FEATURE_DIM), np.float32), membership, no_weights, known=True)
    one_round = replace(settings, vote_rounds=1)
    return refine_by_votes(views, cut, None, {}, one_round, should_stop=should_stop).membership


def _is_level(larger: Float32, membership: Float32) -> bool:
    old, new = membership >= HALF, larger >= HALF
    covers = (old & new).sum() >= _MIN_COVER * old.sum()
    return bool(covers and new.sum() <= _MAX_SIZE * old.sum())


def _voted(
    context: SegmentationContext,
    membership: Float32,
    core: Float32,
    settings: SegmentSettings,
    should_stop: StopCheck,
    *,
    extension: float = 0.0,
    scales: bool = False,
) -> list[Float32]:  # by definition
    """Return the memberships that SAM's masks of an object's box vote for.

    Parameters
    ----------
    context : SegmentationContext
    membership : array of shape [N], float32
        The object whose box is given to SAM.
    core : array of shape [N], float32
        The part of the object that is known to belong.
    settings : SegmentSettings
    should_stop : callable
    extension : float
        Distance by which the box is extended downwards, in heights of the object.
    scales : bool
        Let SAM's part, object and whole vote separately.

    Returns
    -------
    list of arrays of shape [N], float32
        One membership, or one of each scale. Empty without votes, with too few views, and with `scales` if the SAM has
        no scales.
    """
    views = context.views
    points = _extended(views.scene.gaussians.means[membership >= HALF], extension)
    facing = views.facing(points.mean(axis=0))
    boxes = {camera.photo: box for camera in facing if (box := _box(camera, points)) is not None}
    boxed = [camera for camera in facing if camera.photo in boxes]
    encoded = [camera for camera in boxed if camera.photo in context.label_maps]
    candidates = encoded if len(encoded) >= settings.n_level_views else boxed
    cameras = spread_cameras(candidates, settings.n_level_views)
    if len(cameras) < min(_MIN_VIEWS, settings.n_level_views):
        return []
    count = VoteCount(views)
    for camera in cameras:
        if should_stop():
            raise Cancelled("Stopped while searching for the whole object; no object was stored.")
        view, box = views.of(camera), boxes[camera.photo]
        if scales:
            masks = context.photos.segment_scales(camera, box)
            if len(masks) == 1:
                return []
        else:
            masks = [context.photos.segment(camera, box=box)[0]]
        count.add(view, np.dstack([view.from_photo(mask) for mask in masks]))
    voted = count.membership(core[:, None])
    levels = (_connected(views, *columns, core) for columns in zip(voted.T, count.inside.T, strict=True))
    return [level for level in levels if level is not None]


def _connected(views: Views, voted: Float32, inside: Float32, core: Float32) -> Float32 | None:
    """Return a voted membership without members that are not connected to `core`; None without members."""
    members = np.flatnonzero(voted >= HALF)
    if len(members) == 0:
        return None
    connected = connected_parts(views.scene.gaussians.means[members], (inside * (core >= HALF))[members])
    result = np.minimum(voted, BELOW_HALF)
    result[members[connected]] = voted[members[connected]]
    return result


def _extended(points: Float32, extension: float) -> Float32:
    """Return the points without outliers, and a copy of them `extension` heights lower (Z is up)."""
    low, high = np.percentile(points, [1, 99], axis=0)
    inner = points[((points >= low) & (points <= high)).all(axis=1)]
    inner = inner if len(inner) else points
    lower = inner - np.array([0, 0, extension * (high[2] - low[2])], np.float32)
    return np.concatenate([inner, lower]) if extension else inner


def _box(camera: Camera, points: Float32) -> Box | None:
    """Return the bounding box of the points in a photo; None if too little of it is in the photo, or it is tiny."""
    pixels, depth = project(camera, points.astype(np.float64))
    if (depth <= 0).any() or not np.isfinite(pixels).all():
        return None
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    left, top = max(0.0, float(low[0])), max(0.0, float(low[1]))
    right, bottom = min(float(camera.width), float(high[0])), min(float(camera.height), float(high[1]))
    if right - left < _MIN_BOX_SIDE or bottom - top < _MIN_BOX_SIDE:
        return None
    if (right - left) * (bottom - top) < _MIN_BOX_IN_PHOTO * float(np.prod(high - low)):
        return None
    return left, top, right, bottom


def _parts(views: Views, membership: Float32, directions: Float32, settings: SegmentSettings) -> list[Float32]:
    """Return the part of the object whose features are similar to its main direction; none without directions."""
    if len(directions) == 0:
        return []
    similar = views.directions @ directions[0] >= settings.cosine
    return [np.where(similar, membership, np.minimum(membership, BELOW_HALF)).astype(np.float32)]


def _iou(first: Float32, second: Float32) -> float:
    return mask_iou(first >= HALF, second >= HALF)


def _nested(chosen: Float32, others: Sequence[Float32]) -> Levels:
    """Return the chosen level with the others that are clearly smaller or larger, each contained in the next."""
    size = int((chosen >= HALF).sum())
    smaller: list[Float32] = []
    larger: list[Float32] = []
    for level in sorted(others, key=lambda level: int((level >= HALF).sum())):
        count = int((level >= HALF).sum())
        if count == 0 or any(_iou(level, kept) > SAME_LEVEL_IOU for kept in (chosen, *smaller, *larger)):
            continue
        common = int(((level >= HALF) & (chosen >= HALF)).sum())
        if count < size and common >= _MIN_COVER * count:
            smaller.append(np.minimum(level, chosen))
        elif count > size and common >= _MIN_COVER * size:
            larger.append(np.maximum(level, chosen))
    for i in range(1, len(larger)):
        larger[i] = np.maximum(larger[i], larger[i - 1])
    for i in range(len(smaller) - 2, -1, -1):
        smaller[i] = np.minimum(smaller[i], smaller[i + 1])
    return Levels((*smaller, chosen, *larger), len(smaller))
