"""What every group of a scene looks like from a few sides: made once, so that a text can be held against all of them.

A segment of one photo may be half an object, or an object and what it stands on. The groups are told apart by all
photos together, at every level: for an exhibit of which SAM never draws the whole, one of them still is the whole.
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
from ..kept_arrays import keep_arrays, read_kept_arrays
from ..project_folder import stage_key
from ..scene import Camera
from .candidates import FEWEST_PIXELS, crop_of
from .evidence import Seed
from .hierarchy import Hierarchy, build_hierarchy
from .photos import Photos
from .views import LARGEST, View, Views, spread_cameras

if TYPE_CHECKING:
    from ..grounding import Detector

__all__ = ["GroupLooks", "load_or_make_looks", "make_looks", "evidence_of_groups"]

Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]
Mask = NDArray[np.bool_]

_VERSION = 3
_PICTURE = "picture "
_N_VIEWS = 16
_N_SIGHTINGS = 3
_CHANNELS = 60
"""Groups rendered at once."""

_LEAST_SCORE = 0.05
_NEARLY = 0.9


@dataclass(frozen=True)
class GroupLooks:
    """Groups, and how a detector describes what is seen of them.

    Attributes
    ----------
    hierarchy : Hierarchy
    pictures : dict of str to int32 array of shape [h, w]
        The finest group that each pixel of some photos' views shows, -1 for none; [w, h] is the view's frame.
    group : int32 array of shape [S]
        Of each sighting: the group.
    photo : tuple of S str
        And where it is seen.
    described : array of shape [S, D], float32
        And what it looks like, by `Detector.describe_crops`.
    """

    hierarchy: Hierarchy
    pictures: dict[str, Int32]
    group: Int32
    photo: tuple[str, ...]
    described: Float32


def make_looks(
    views: Views, photos: Photos, detector: Detector, *, emit: Emit, should_stop: StopCheck
) -> GroupLooks | None:
    """Return what the groups of a scene look like; None from a detector that does not describe what it sees.

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
        When `should_stop` says so.
    """
    hierarchy = build_hierarchy(views)
    cameras = spread_cameras(views.cameras.cameras, _N_VIEWS)
    pictures: dict[str, Int32] = {}
    for number, camera in enumerate(cameras):
        _go_on(should_stop)
        pictures[camera.photo] = _picture(views, views.of(camera), hierarchy)
        emit(Progress("objects", 0.3 * (number + 1) / len(cameras), message="Looking at what there is"))
    sightings = _sightings(views, hierarchy, pictures, cameras)
    group: list[int] = []
    photo: list[str] = []
    described: list[Float32] = []
    for number, camera in enumerate(cameras):
        _go_on(should_stop)
        view = views.of(camera)
        own = [one for one, where in sightings if where == camera.photo]
        masks = (hierarchy.within(pictures[camera.photo], one) for one in own)
        crops = [(one, crop_of(view, mask, photos)) for one, mask in zip(own, masks, strict=True)]
        there = [(one, crop) for one, crop in crops if crop is not None]
        if there:
            rows = detector.describe_crops(
                photos.pixels(camera), [crop[1] for _, crop in there], [crop[2] for _, crop in there]
            )
            if rows is None:
                return None
            described.append(rows)
            group += [one for one, _ in there]
            photo += [camera.photo] * len(there)
        emit(Progress("objects", 0.3 + 0.7 * (number + 1) / len(cameras), message="Looking at what there is"))
    rows = np.concatenate(described) if described else np.zeros((0, 1), np.float32)
    return GroupLooks(hierarchy, pictures, np.array(group, np.int32), tuple(photo), rows.astype(np.float32))


def _go_on(should_stop: StopCheck) -> None:
    if should_stop():
        raise Cancelled("Stopped while looking at what there is; no object was stored.")


def _picture(views: Views, view: View, hierarchy: Hierarchy) -> Int32:
    """Return the finest group that most of each pixel of a view shows, -1 where groups cover less than half of it."""
    best = np.full(view.within.shape, -1, np.int32)
    most, total = np.zeros(best.shape, np.float32), np.zeros(best.shape, np.float32)
    for first in range(0, hierarchy.n_finest, _CHANNELS):
        count = min(_CHANNELS, hierarchy.n_finest - first)
        single = (hierarchy.finest[:, None] == np.arange(first, first + count)).astype(np.float32)
        shares = views.scene.render(view.frame, channels=single).channels
        largest = shares.max(axis=-1)
        best = np.where(largest > most, first + shares.argmax(axis=-1), best).astype(np.int32)
        most, total = np.maximum(most, largest), total + shares.sum(axis=-1)
    return np.where((total > 0.5) & view.within, best, -1).astype(np.int32)


def _sightings(
    views: Views, hierarchy: Hierarchy, pictures: dict[str, Int32], cameras: list[Camera]
) -> list[tuple[int, str]]:
    """Return groups and photos that show them large and whole, from sides that differ."""
    means = views.scene.gaussians.means
    unit = views.cameras_spread
    areas = {
        photo: np.bincount(picture[picture >= 0], minlength=hierarchy.n_finest) for photo, picture in pictures.items()
    }
    rims = {photo: _on_rim(picture, hierarchy.n_finest) for photo, picture in pictures.items()}
    found = []
    for number, (first, stop) in enumerate(hierarchy.groups):
        members = hierarchy.members(number)
        low, high = np.percentile(means[members], [5, 95], axis=0) if members.any() else (0.0, np.inf)
        if np.max(high - low) > LARGEST * unit:
            continue
        seen = [(int(areas[c.photo][first:stop].sum()), bool(rims[c.photo][first:stop].any()), c) for c in cameras]
        seen = [one for one in seen if one[0] >= FEWEST_PIXELS]
        whole = [one for one in seen if not one[1]] or seen
        largest = max((one[0] for one in whole), default=0)
        good = [camera for area, _, camera in whole if area >= 0.5 * largest]
        found += [(number, camera.photo) for camera in spread_cameras(good, _N_SIGHTINGS)] if good else []
    return found


def _on_rim(picture: Int32, count: int) -> Mask:
    """Return which finest groups touch the rim of what the photo shows."""
    rim = np.concatenate([picture[[0, -1]].ravel(), picture[:, [0, -1]].ravel()])
    return np.bincount(rim[rim >= 0], minlength=count) > 0


def evidence_of_groups(text: str, looks: GroupLooks, views: Views, detector: Detector, count: int) -> list[Seed]:
    """Return groups that stand out and look like what `text` names, each where it is seen largest.

    Part of an object may look as much like it as the whole does, and stand out as much. So each group comes with the
    largest one around it that is nearly as good, and none that lies in, or around, a better one is taken on its own
    account.

    Parameters
    ----------
    text : str
    looks : GroupLooks
    views : Views
    detector : Detector
        That which described them.
    count : int
        Seeds, at most.

    Raises
    ------
    PromptError
        When the text is not known.
    """
    if len(looks.group) == 0:
        return []
    scores = np.asarray(detector.score_described(looks.described, text), np.float64)
    groups = looks.hierarchy.groups
    seen = np.bincount(looks.group, minlength=len(groups))
    mean = np.bincount(looks.group, weights=scores, minlength=len(groups)) / np.maximum(seen, 1)
    value = mean * np.sqrt(looks.hierarchy.standing)
    chosen: list[int] = []
    for group in np.argsort(-value, kind="stable"):
        if len(chosen) >= count or value[group] < _LEAST_SCORE:
            break
        first, stop = groups[group]
        around = (groups[:, 0] <= first) & (groups[:, 1] >= stop)
        inside = (groups[:, 0] >= first) & (groups[:, 1] <= stop)
        if (around | inside)[chosen].any():
            continue
        good = np.flatnonzero(around & (value >= _NEARLY * value[group]))
        whole = good[np.argmax(groups[good, 1] - groups[good, 0])]
        chosen += [int(group)] if whole == group else [int(group), int(whole)]
    cameras = {camera.photo: camera for camera in views.cameras.cameras}
    seeds = []
    for group in chosen[:count]:
        own = np.flatnonzero(looks.group == group)
        masks = {int(i): looks.hierarchy.within(looks.pictures[looks.photo[i]], group) for i in own}
        largest = max(masks, key=lambda i: int(masks[i].sum()))
        view = views.of(cameras[looks.photo[largest]])
        seeds.append(Seed(view, masks[largest], float(scores[own].max()), members=looks.hierarchy.members(group)))
    return seeds


def load_or_make_looks(
    file: Path, views: Views, photos: Photos, detector: Detector, *, emit: Emit, should_stop: StopCheck
) -> GroupLooks | None:
    """Return the looks kept in `file`, or make them and keep them there: derived data, made anew when damaged.

    A disk that refuses costs only time. Parameters and errors are those of `make_looks`.
    """
    recipe = _recipe(views, detector)
    kept = read_kept_arrays(file, recipe)
    if kept is not None:
        return _from_arrays(kept)
    made = make_looks(views, photos, detector, emit=emit, should_stop=should_stop)
    if made is not None:
        keep_arrays(file, recipe, _arrays(made))
    return made


def _recipe(views: Views, detector: Detector) -> str:
    gaussians = views.scene.gaussians
    assert gaussians.features is not None
    digest = hashlib.sha256()
    for array in (gaussians.means, gaussians.opacities, gaussians.features):
        digest.update(np.ascontiguousarray(array).data)
    photos = [camera.photo for camera in views.cameras.cameras]
    return stage_key(_VERSION, detector.name, views.render_side, photos, digest.hexdigest())


def _arrays(looks: GroupLooks) -> dict[str, NDArray[Any]]:
    return {
        "finest": looks.hierarchy.finest,
        "groups": looks.hierarchy.groups,
        "standing": looks.hierarchy.standing,
        "group": looks.group,
        "photo": np.array(looks.photo, dtype=np.str_),
        "described": looks.described.astype(np.float16),
        **{_PICTURE + photo: picture.astype(np.int16) for photo, picture in looks.pictures.items()},
    }


def _from_arrays(arrays: dict[str, NDArray[Any]]) -> GroupLooks:
    return GroupLooks(
        Hierarchy(arrays["finest"], arrays["groups"], arrays["standing"]),
        {
            name.removeprefix(_PICTURE): picture.astype(np.int32)
            for name, picture in arrays.items()
            if name.startswith(_PICTURE)
        },
        arrays["group"],
        tuple(str(photo) for photo in arrays["photo"]),
        arrays["described"].astype(np.float32),
    )
