"""Appearance of every group of a scene from a few sides, described once and then compared with any text.

A segment of one photo may be half an object, or an object and its support. The groups are computed from all photos
together, at every level: where SAM never outlines the whole of an object, one of the groups still is the whole object.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled
from ..events import Emit, Progress, StopCheck
from ..files import ArraySpec, keep_arrays, read_kept_arrays
from ..project_folder import stage_key
from ..scene import Camera
from .crops import MIN_VISIBLE_PIXELS, crop_photo
from .hierarchy import Hierarchy, build_hierarchy
from .photos import Photos
from .views import MAX_OBJECT_EXTENT, View, Views, spread_cameras

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = ["GroupAppearance", "describe_groups", "load_or_describe_groups"]

Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]
Mask = NDArray[np.bool_]

_VERSION = 3  # by definition
_GROUP_MAP_PREFIX = "picture "
"""First part of the stored names of the group maps; the name of the photo follows."""

_SPECS = {
    "groups": ArraySpec("int32", ("k", 2)),
    "standing": ArraySpec("float32", ("k",), finite=True),
    "group": ArraySpec("int32", ("s",)),
    "photo": ArraySpec("str", ("s",)),
    "described": ArraySpec("float16", ("s", "d"), finite=True),
}  # by definition

_N_VIEWS = 16  # chosen on museum_room
"""Photos for which group maps are rendered."""

_N_SIGHTINGS = 3  # chosen on museum_room, store_room
"""Photos from which each group is described, at most."""

_N_CHANNELS = 60  # by definition
"""Groups rendered in one pass. More need more memory and give the same maps."""


@dataclass(frozen=True)
class GroupAppearance:
    """The groups of a scene, and how a detector describes them in photos that show them.

    Attributes
    ----------
    hierarchy : Hierarchy
    group_maps : dict of str to int32 array of shape [h, w]
        By photo: the finest group that each pixel shows, -1 for none; [h, w] is the view's frame.
    group : int32 array of shape [S]
        The group of each sighting: a group in a photo that shows it.
    photo : tuple of S str
        The photo of each sighting.
    described : array of shape [S, D], float32
        The description of each sighting, by `Detector.describe_crops`.
    """

    hierarchy: Hierarchy
    group_maps: dict[str, Int32]
    group: Int32
    photo: tuple[str, ...]
    described: Float32


def describe_groups(
    views: Views, photos: Photos, detector: Detector, *, emit: Emit, should_stop: StopCheck
) -> GroupAppearance | None:
    """Return the appearance of a scene's groups; None for a detector that does not describe crops.

    Parameters
    ----------
    views : Views
    photos : Photos
    detector : Detector
    emit, should_stop
        See `engine.events`.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """
    hierarchy = build_hierarchy(views)
    cameras = spread_cameras(views.cameras.cameras, _N_VIEWS)
    group_maps: dict[str, Int32] = {}
    for number, camera in enumerate(cameras):
        _check_stop(should_stop)
        group_maps[camera.photo] = _group_map(views, views.of(camera), hierarchy)
        emit(Progress("objects", 0.3 * (number + 1) / len(cameras), message="Describing the groups"))
    sightings = _sightings(views, hierarchy, group_maps, cameras)
    group: list[int] = []
    photo: list[str] = []
    described: list[Float32] = []
    for number, camera in enumerate(cameras):
        _check_stop(should_stop)
        view = views.of(camera)
        groups_here = [one for one, name in sightings if name == camera.photo]
        masks = (hierarchy.within(group_maps[camera.photo], one) for one in groups_here)
        all_crops = [(one, crop_photo(view, mask, photos)) for one, mask in zip(groups_here, masks, strict=True)]
        crops = [(one, crop) for one, crop in all_crops if crop is not None]
        if crops:
            rows = detector.describe_crops(
                photos.pixels(camera), [crop[1] for _, crop in crops], [crop[2] for _, crop in crops]
            )
            if rows is None:
                return None
            described.append(rows)
            group += [one for one, _ in crops]
            photo += [camera.photo] * len(crops)
        emit(Progress("objects", 0.3 + 0.7 * (number + 1) / len(cameras), message="Describing the groups"))
    rows = np.concatenate(described) if described else np.zeros((0, 1), np.float32)
    return GroupAppearance(hierarchy, group_maps, np.array(group, np.int32), tuple(photo), rows.astype(np.float32))


def _check_stop(should_stop: StopCheck) -> None:
    if should_stop():
        raise Cancelled("Stopped while describing the groups of the scene; no object was stored.")


def _group_map(views: Views, view: View, hierarchy: Hierarchy) -> Int32:
    """Return the finest group with the largest share of each pixel; -1 where groups cover less than half of it."""
    best = np.full(view.within.shape, -1, np.int32)
    best_share, total = np.zeros(best.shape, np.float32), np.zeros(best.shape, np.float32)
    for first in range(0, hierarchy.n_finest, _N_CHANNELS):
        count = min(_N_CHANNELS, hierarchy.n_finest - first)
        one_hot = (hierarchy.finest[:, None] == np.arange(first, first + count)).astype(np.float32)
        shares = views.scene.render(view.frame, channels=one_hot).channels
        largest = shares.max(axis=-1)
        best = np.where(largest > best_share, first + shares.argmax(axis=-1), best).astype(np.int32)
        best_share, total = np.maximum(best_share, largest), total + shares.sum(axis=-1)
    return np.where((total > 0.5) & view.within, best, -1).astype(np.int32)


def _sightings(
    views: Views, hierarchy: Hierarchy, group_maps: dict[str, Int32], cameras: list[Camera]
) -> list[tuple[int, str]]:
    """Return pairs of a group and a photo that shows it large and whole, from different sides."""
    means = views.scene.gaussians.means
    unit = views.cameras_spread
    areas = {photo: np.bincount(map_[map_ >= 0], minlength=hierarchy.n_finest) for photo, map_ in group_maps.items()}
    cut_off = {photo: _touch_border(map_, hierarchy.n_finest) for photo, map_ in group_maps.items()}
    found = []
    for number, (first, stop) in enumerate(hierarchy.groups):
        members = hierarchy.members(number)
        low, high = np.percentile(means[members], [5, 95], axis=0) if members.any() else (0.0, np.inf)
        if np.max(high - low) > MAX_OBJECT_EXTENT * unit:
            continue
        seen = [(int(areas[c.photo][first:stop].sum()), bool(cut_off[c.photo][first:stop].any()), c) for c in cameras]
        seen = [sighting for sighting in seen if sighting[0] >= MIN_VISIBLE_PIXELS]
        whole = [sighting for sighting in seen if not sighting[1]] or seen
        largest = max((area for area, _, _ in whole), default=0)
        good = [camera for area, _, camera in whole if area >= 0.5 * largest]
        found += [(number, camera.photo) for camera in spread_cameras(good, _N_SIGHTINGS)] if good else []
    return found


def _touch_border(group_map: Int32, count: int) -> Mask:
    """Return which finest groups touch the border of the view's frame, bool [count]."""
    border = np.concatenate([group_map[[0, -1]].ravel(), group_map[:, [0, -1]].ravel()])
    return np.bincount(border[border >= 0], minlength=count) > 0


def load_or_describe_groups(
    file: Path, views: Views, photos: Photos, detector: Detector, *, emit: Emit, should_stop: StopCheck
) -> GroupAppearance | None:
    """Return the appearance stored in `file`, or compute and store it.

    A missing, damaged or outdated file is computed again; a file that cannot be written only costs time. The other
    parameters and the errors are those of `describe_groups`.
    """
    recipe = _recipe(views, detector)
    specs = {"finest": ArraySpec("int32", (len(views.scene.gaussians.means),)), **_SPECS}
    stored = read_kept_arrays(file, recipe, specs, optional={_GROUP_MAP_PREFIX + "*": ArraySpec("int16", (-1, -1))})
    known = None if stored is None else _from_arrays(stored)
    if known is not None:
        return known
    appearance = describe_groups(views, photos, detector, emit=emit, should_stop=should_stop)
    if appearance is not None:
        keep_arrays(file, recipe, _to_arrays(appearance))
    return appearance


def _recipe(views: Views, detector: Detector) -> str:
    gaussians = views.scene.gaussians
    assert gaussians.features is not None
    digest = hashlib.sha256()
    for array in (gaussians.means, gaussians.opacities, gaussians.features):
        digest.update(np.ascontiguousarray(array).data)
    photos = [camera.photo for camera in views.cameras.cameras]
    return stage_key(_VERSION, detector.name, views.render_side, photos, digest.hexdigest())


def _to_arrays(appearance: GroupAppearance) -> dict[str, NDArray[Any]]:
    # The names are those of release 0.1.0.
    return {
        "finest": appearance.hierarchy.finest,
        "groups": appearance.hierarchy.groups,
        "standing": appearance.hierarchy.prominence,
        "group": appearance.group,
        "photo": np.array(appearance.photo, dtype=np.str_),
        "described": appearance.described.astype(np.float16),
        **{_GROUP_MAP_PREFIX + photo: map_.astype(np.int16) for photo, map_ in appearance.group_maps.items()},
    }


def _from_arrays(arrays: dict[str, NDArray[Any]]) -> GroupAppearance | None:
    """Return the appearance; None when an array holds what is no group or no photo."""
    groups, group, finest = arrays["groups"], arrays["group"], arrays["finest"]
    maps = {name.removeprefix(_GROUP_MAP_PREFIX): map_ for name, map_ in arrays.items() if _is_group_map(name)}
    n_finest = int(groups[:, 1].max(initial=0))
    in_range = (
        (groups[:, 0] >= 0).all()
        and (groups[:, 0] < groups[:, 1]).all()
        and (group >= 0).all()
        and (group < len(groups)).all()
        and set(arrays["photo"].tolist()) <= set(maps)
        and all((map_ >= -1).all() and (map_ < n_finest).all() for map_ in (finest, *maps.values()))
    )
    if not in_range:
        return None
    return GroupAppearance(
        Hierarchy(finest, groups, arrays["standing"]),
        {photo: map_.astype(np.int32) for photo, map_ in maps.items()},
        group,
        tuple(str(photo) for photo in arrays["photo"]),
        arrays["described"].astype(np.float32),
    )


def _is_group_map(name: str) -> bool:
    return name.startswith(_GROUP_MAP_PREFIX)
