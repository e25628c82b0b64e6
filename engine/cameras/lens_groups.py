"""Lenses of photos that were taken to share one: found to differ after the first model, they are grouped again.

Photos of equal size without EXIF start with a common lens. Where some were zoomed, the model is wrong by half its size
with a reprojection error below a pixel. See docs/design_notes/cameras.md.
"""

from __future__ import annotations

import contextlib
import copy
import logging
import math
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, wait
from dataclasses import dataclass

import numpy as np

from ..core.errors import DiskError
from ..core.events import StopCheck
from .colmap import pycolmap
from .colmap_calls import lens_of, opened_database
from .feature_scales import SIZES_DIFFER, photos_at_gap, relative_scales, scale_groups, size_gap
from .features import SfmWorkspace
from .lens_trials import LensTrial, ModelTrials, capped_error, tried_apart, tried_lenses

MapPhotos = Callable[[SfmWorkspace, Sequence[str], StopCheck], list[pycolmap.Reconstruction]]
"""Maps the photos of these names in the database of a workspace, all without names, with the lenses in it."""
Models = tuple[list[pycolmap.Reconstruction], ModelTrials | None]
"""Models, and the trials of the largest one, None where none were made."""
Group = tuple[pycolmap.Camera, list[int]]
"""A lens and the image ids of the photos that share it."""

_LOWER_ERROR = 0.9
"""Error with own lenses, relative to that with shared ones, from which down lenses can differ: sound sets
have 0.95 to 0.98, zoomed ones 0.27 to 0.78."""  # chosen on museum_room, room_1, room_3, room_5, banana16
_DIFFERENT_FOCAL = 1.06
"""Ratio of focal lengths from which on photos have different lenses. Sound sets stay
below 1.02."""  # chosen on museum_room, room_1, room_3, room_5, banana16
_FEW_PLACED = 0.8
"""Share of placed photos below which lenses of their own are tried even if no model shows that they differ."""
_WIDTHS = (1.25, 1.12, _DIFFERENT_FOCAL)
"""Factors within which focal lengths make a group, one after the other until the photos of each agree. Those of a lens
per photo scatter, and in a group with others even a badly known one is found."""
_COUNTS = (2, 3)
"""Groups that photos are cut into by the sizes of features."""
_SAMPLE = 60
"""Photos that other groups are tried on first where only the sizes of features speak for them: a walk through rooms
shows things from near and from far, and each of the groups costs a mapping."""
_BETTER = 0.95
"""Error of the model with other groups, relative to the first, from which down it is taken."""
_LOG = logging.getLogger(__name__)


def map_with_lenses(
    workspace: SfmWorkspace, map_photos: MapPhotos, *, beside: Executor, should_stop: StopCheck
) -> Models:
    """Return the models of the photos, mapped with lenses that their photos really share.

    With them come the trials of the largest model; None where none were made.

    Parameters
    ----------
    workspace : SfmWorkspace
        With features and matches. The lenses in its database are replaced.
    map_photos : callable
        Maps photos with the lenses in the database.
    beside : Executor
        Of two threads, in which trials go on.

    Raises
    ------
    CameraError, Cancelled, DiskError
        As `map_photos` and the calls of COLMAP raise them.

    Notes
    -----
    After the first model each photo gets its own focal length. If the error falls by a tenth or more and focal lengths
    of one group differ by 6 %, if a fifth of the photos could not be placed, or if the photos fall into groups that
    show things in different sizes, other groups are tried: two and three groups by the sizes of common features, then a
    lens for each photo, grouped by sizes where these fall apart, and by the focal lengths found, coarsely first. A
    result is taken when it places as many photos with an error that is smaller by a twentieth, or more photos. Where
    sizes of features and focal lengths found both say that photos were zoomed, a smaller error is enough. Of more than
    60 photos for which sizes alone speak for other groups, 60 are tried first: while all are mapped, with a database of
    their own.
    """
    first_lenses = _first_lenses(workspace)
    assign_lenses(workspace, first_lenses)
    count = len(workspace.copies)
    several_sizes = not workspace.lenses and size_gap(workspace.database) >= SIZES_DIFFER
    scales = relative_scales(workspace.database) if several_sizes else {}
    with contextlib.ExitStack() as running:
        sample = None
        if several_sizes and count > _SAMPLE:
            sample = _begun_sample(workspace, first_lenses, scales, map_photos, beside, should_stop)
            if sample is not None:
                running.callback(sample.end)
        models = map_photos(workspace, (), should_stop)
        largest = largest_model(models)
        if workspace.lenses or largest is None or largest.num_reg_images() < 3:
            return models, None
        trials = ModelTrials.begun(largest, workspace.sparse.parent, beside, should_stop=should_stop)
        doubtful = _is_doubtful(largest, count, lenses_differ(largest, trials.own))
        if not (doubtful or several_sizes) or (not doubtful and sample is not None and not sample.speaks_for_others()):
            return models, trials
    search = _Search(workspace, first_lenses, scales or relative_scales(workspace.database), several_sizes, should_stop)
    best, own = search.best_models(models, trials.own, count, lambda: map_photos(workspace, (), should_stop))
    if best is models:
        return models, trials
    return best, None if own is None else ModelTrials(own)


def _begun_sample(
    workspace: SfmWorkspace,
    first_lenses: Sequence[Group],
    scales: dict[int, float],
    map_photos: MapPhotos,
    beside: Executor,
    should_stop: StopCheck,
) -> _Sample | None:
    """Return a sample of the photos; None where the disk has no room for its database: all are tried then."""
    try:
        of_sample = workspace.mapped_beside()
    except DiskError as error:
        _LOG.warning("%s Other lenses are tried on all photos.", error)
        _delete_beside(workspace)
        return None
    return _Sample(of_sample, first_lenses, scales, map_photos, beside, should_stop)


def _delete_beside(workspace: SfmWorkspace) -> None:
    """Delete the files of a sample; what cannot be deleted now, the next run deletes."""
    try:
        workspace.delete_beside()
    except DiskError as error:
        _LOG.warning("%s", error)


class _Sample:
    """Some photos that are mapped with other lenses in a thread, from its creation to `end`.

    Parameters
    ----------
    workspace : SfmWorkspace
        With a database of its own.
    """

    def __init__(
        self,
        workspace: SfmWorkspace,
        first_lenses: Sequence[Group],
        scales: dict[int, float],
        map_photos: MapPhotos,
        beside: Executor,
        should_stop: StopCheck,
    ) -> None:
        self._workspace, self._map_photos = workspace, map_photos
        self._given_up = threading.Event()
        self._should_stop: StopCheck = lambda: self._given_up.is_set() or should_stop()
        self._search = _Search(workspace, first_lenses, scales, True, self._should_stop)
        self._answer = beside.submit(self._found)

    def speaks_for_others(self) -> bool:
        """Return whether other lenses are better for these photos, or too few of them can be placed to tell."""
        return self._answer.result()

    def end(self) -> None:
        """Give up what is not done, and delete the files."""
        self._given_up.set()
        wait([self._answer])
        _delete_beside(self._workspace)

    def _found(self) -> bool:
        names = photos_at_gap(self._workspace.database, _SAMPLE)

        def mapped() -> list[pycolmap.Reconstruction]:
            return self._map_photos(self._workspace, names, self._should_stop)

        few = mapped()
        largest = largest_model(few)
        if largest is None or largest.num_reg_images() < 3:
            return True
        own = tried_apart(largest, "own", self._workspace.sparse.parent, should_stop=self._should_stop)
        return self._search.best_models(few, own, len(names), mapped)[0] is not few


@dataclass(frozen=True)
class _Search:
    """The search for the lenses that photos share, on all photos or on some of them.

    Attributes
    ----------
    workspace : SfmWorkspace
    first_lenses : sequence of Group
    scales : dict of int to float
        Logarithms by image id, see `relative_scales`.
    several_sizes : bool
        Whether the photos fall into groups that show things in different sizes.
    should_stop : StopCheck
    """

    workspace: SfmWorkspace
    first_lenses: Sequence[Group]
    scales: dict[int, float]
    several_sizes: bool
    should_stop: StopCheck

    def best_models(
        self,
        models: list[pycolmap.Reconstruction],
        own: LensTrial,
        count: int,
        map_again: Callable[[], list[pycolmap.Reconstruction]],
    ) -> tuple[list[pycolmap.Reconstruction], LensTrial | None]:
        """Return the best models of `count` photos: those with other lenses, or `models` with their trial `own`.

        Parameters
        ----------
        models : list of pycolmap.Reconstruction
            With the first lenses; one has at least three photos.
        map_again : callable
            Maps the same photos with the lenses in the database.
        """
        largest = largest_model(models)
        assert largest is not None
        differ = lenses_differ(largest, own)

        def mapped(groups: Sequence[Group]) -> list[pycolmap.Reconstruction]:
            assign_lenses(self.workspace, [*groups, *self._left_by(groups)])
            return map_again()

        best = models
        for number in _COUNTS:
            groups = _by_scale(self.first_lenses, self.scales, number)
            found = mapped(groups) if groups else []
            model = largest_model(found)
            if model is None or not (
                _is_better(model, largest)
                or (self.several_sizes and _has_zooms(model) and _is_better(model, largest, 1.0))
            ):
                continue
            best, largest = found, model
            own = tried_lenses(model, should_stop=self.should_stop)
            differ = lenses_differ(model, own)
            if not _is_doubtful(model, count, differ):
                return best, own
        # Lenses of their own begin with what fits the first model, if that shows that they differ.
        of_each = mapped([(lens, [i]) for i, lens in sorted(own.lenses.items())] if differ else [])
        alone = largest_model(of_each)
        if alone is None or not _is_better(alone, largest):
            return best, own
        first = largest
        lenses = {i: lens_of(alone, i) for i in alone.reg_image_ids()}
        for group_of, width in self._attempts():
            found = mapped(group_by_focal(lenses, group_of, width))
            model = largest_model(found)
            if model is None or not _is_better(model, largest):
                continue
            best, largest = found, model
            own = tried_lenses(model, should_stop=self.should_stop)
            if not lenses_differ(model, own):
                break
            lenses = {**lenses, **own.lenses}
        if best is models and _is_better(alone, first, _LOWER_ERROR):
            return of_each, None
        return best, own

    def _left_by(self, groups: Sequence[Group]) -> list[Group]:
        """Return a lens of its own for each photo that is in no group."""
        grouped = {image_id for _, ids in groups for image_id in ids}
        return [
            (_scaled(lens, self.scales[i]), [i]) for lens, ids in self.first_lenses for i in ids if i not in grouped
        ]

    def _attempts(self) -> list[tuple[dict[int, int], float]]:
        """Return the groups by image id, and the factor within which focal lengths are one lens, in order."""
        group_of = {image_id: number for number, (_, ids) in enumerate(self.first_lenses) for image_id in ids}
        attempts = [(group_of, width) for width in _WIDTHS]
        if self.several_sizes:
            # A badly known focal length does not take a photo out of the group that sizes show.
            by_size = _size_groups(self.first_lenses, self.scales)
            attempts = [*((of_size, math.inf) for of_size in by_size if of_size), *attempts]
        return attempts


def _is_doubtful(model: pycolmap.Reconstruction, count: int, differ: bool) -> bool:
    return differ or model.num_reg_images() < _FEW_PLACED * count


def _size_groups(first_lenses: Sequence[Group], scales: dict[int, float]) -> list[dict[int, int]]:
    """Return the group of each photo by image id, cut into two and into three by sizes; empty where that cuts none."""
    return [
        {image_id: number for number, (_, ids) in enumerate(_by_scale(first_lenses, scales, count)) for image_id in ids}
        for count in _COUNTS
    ]


def _has_zooms(model: pycolmap.Reconstruction) -> bool:
    """Return whether the focal lengths of `model` differ as zooms do."""
    focals = [lens_of(model, i).mean_focal_length() for i in model.reg_image_ids()]
    return max(focals) >= SIZES_DIFFER * min(focals)


def _scaled(lens: pycolmap.Camera, scale: float) -> pycolmap.Camera:
    """Return a lens whose focal length is longer by ``exp(scale)``."""
    new = copy.deepcopy(lens)
    params = np.array(new.params)
    params[new.focal_length_idxs()] *= np.exp(scale)
    new.params = params
    return new


def _by_scale(first_lenses: Sequence[Group], scales: dict[int, float], count: int) -> list[Group]:
    """Return each group of photos cut into `count` by the sizes of common features, if that cuts any."""
    cut: list[Group] = []
    for lens, ids in first_lenses:
        parts = scale_groups({i: scales[i] for i in ids}, count)
        cut += [(_scaled(lens, scale), members) for scale, members in parts] or [(lens, list(ids))]
    return cut if len(cut) > len(first_lenses) else []


def lenses_differ(model: pycolmap.Reconstruction, own: LensTrial) -> bool:
    """Return whether photos that share a lens in `model` fit clearly better with different focal lengths."""
    if not own.lenses or own.error > _LOWER_ERROR * own.before:
        return False
    ratios = own.focal_ratios(model)
    by_lens: dict[int, list[float]] = {}
    for image_id, ratio in ratios.items():
        by_lens.setdefault(model.image(image_id).camera_id, []).append(ratio)
    return any(max(found) > _DIFFERENT_FOCAL * min(found) for found in by_lens.values())


def group_by_focal(
    lenses: dict[int, pycolmap.Camera], group_of: dict[int, int], width: float = _DIFFERENT_FOCAL
) -> list[Group]:
    """Return groups of photos of one former group whose focal lengths differ by a factor of less than `width`.

    Parameters
    ----------
    lenses : dict of int to pycolmap.Camera
        pycolmap.Camera by image id.
    group_of : dict of int to int
        Former group by image id.
    width : float
        Largest factor between the focal lengths of a group.

    Returns
    -------
    list of (pycolmap.Camera, list of int)
        A lens with the median focal length, and the photos that share it.
    """
    groups: list[Group] = []
    for number in sorted(set(group_of.values())):
        ids = sorted(
            (image_id for image_id in lenses if group_of[image_id] == number),
            key=lambda image_id: (lenses[image_id].mean_focal_length(), image_id),
        )
        members: list[int] = []
        for image_id in ids:
            focal = lenses[image_id].mean_focal_length()
            if members and focal > width * lenses[members[0]].mean_focal_length():
                groups.append((copy.deepcopy(lenses[members[len(members) // 2]]), members))
                members = []
            members.append(image_id)
        if members:
            groups.append((copy.deepcopy(lenses[members[len(members) // 2]]), members))
    return groups


def assign_lenses(workspace: SfmWorkspace, groups: Sequence[Group]) -> None:
    """Give the photos of the database new lenses: one for the image ids of each group."""
    with opened_database(workspace.database) as database:
        frames = {frame.frame_id: frame for frame in database.read_all_frames()}
        for lens, image_ids in groups:
            new = copy.deepcopy(lens)
            new.camera_id = database.write_camera(new)
            sensor = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, new.camera_id)
            rig = pycolmap.Rig()
            rig.add_ref_sensor(sensor)
            rig_id = database.write_rig(rig)
            for image_id in image_ids:
                image = database.read_image(image_id)
                frame = frames[image.frame_id]
                frame.clear_data_ids()
                frame.rig_id = rig_id
                frame.add_data_id(pycolmap.data_t(sensor, image_id))
                database.update_frame(frame)
                image.camera_id = new.camera_id
                database.update_image(image)


def _first_lenses(workspace: SfmWorkspace) -> list[Group]:
    """Return the lens that each group of copies began with, whatever a stopped run assigned since."""
    with opened_database(workspace.database) as database:
        lenses = {lens.camera_id: lens for lens in database.read_all_cameras()}
        members: dict[str, list[int]] = {}
        for image in sorted(database.read_all_images(), key=lambda image: image.image_id):
            members.setdefault(image.name.split("/")[0], []).append(image.image_id)
    # The lenses of the groups were the first that the database got, in the order of the groups.
    return [
        (lenses[camera_id], members[name]) for camera_id, name in zip(sorted(lenses), sorted(members), strict=False)
    ]


def largest_model(models: list[pycolmap.Reconstruction]) -> pycolmap.Reconstruction | None:
    """Return the model with the most photos, and of several the one with the most points; None without any."""
    return max(models, key=lambda model: (model.num_reg_images(), model.num_points3D()), default=None)


def _is_better(model: pycolmap.Reconstruction, than: pycolmap.Reconstruction, lower: float = _BETTER) -> bool:
    more = model.num_reg_images() - than.num_reg_images()
    return more > 0 or (more == 0 and capped_error(model) < lower * capped_error(than))
