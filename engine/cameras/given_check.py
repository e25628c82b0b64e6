"""Given cameras against their photos: features of neighbouring photos must lie where the cameras say."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from ..core.arrays import evenly_spaced_indices
from ..core.errors import CameraError
from ..core.events import Emit, Progress, StopCheck, Warned, ignore_events, never_stop
from ..scene import CameraHealth, CameraSet, PhotoSet
from .evidence import Evidence, PairFit, fit_of_pairs
from .features import SfmWorkspace, match_features
from .health import are_refuted, judge, refuted_images
from .settings import CameraSettings
from .triangulation import posed_model

_SETTINGS = CameraSettings(max_side=640, max_features=1000, first_octave=0)
"""Of the features that are matched for the check: fewer than for finding cameras, about a second a photo."""
_MAX_PHOTOS = 200
"""Photos that are checked, evenly spaced in the order of their names."""
_SUSPECTS = 8
"""Photos that agree least with the cameras, of which every two are tried exchanged."""  # by definition
_KEPT_SHARE = 0.5
"""Share of refuted photos up to which only these are left out; above it the whole model is in doubt."""


def check_given_cameras(
    camera_set: CameraSet, photo_set: PhotoSet, *, emit: Emit = ignore_events, should_stop: StopCheck = never_stop
) -> CameraSet:
    """Return given cameras with their health, without those whose photos they cannot belong to.

    Parameters
    ----------
    camera_set : CameraSet
        As read from a model.
    emit : Emit
        Receives `Progress`, and a `Warned` for a finding.

    Returns
    -------
    CameraSet
        Photos that match their strongest partners nowhere near where the model says are unregistered, if they are less
        than half of the photos; otherwise all cameras stay, with a red health.

    Raises
    ------
    PhotoError, DiskError, Cancelled
        As `match_features` raises them.
    """
    by_photo = camera_set.by_photo
    placed = [photo for photo in photo_set.photos if photo.name in by_photo]
    if len(placed) < 3:
        return camera_set
    chosen = tuple(placed[index] for index in evenly_spaced_indices(len(placed), _MAX_PHOTOS))
    photos = PhotoSet(photo_set.folder, chosen, ())
    with tempfile.TemporaryDirectory(prefix="gaussian-heritage-") as folder:
        workspace = SfmWorkspace(Path(folder), photos, _SETTINGS, by_photo)
        try:
            match_features(
                workspace,
                report=lambda done, message: emit(Progress("cameras", done, None, f"checking the cameras: {message}")),
                should_stop=should_stop,
            )
        except CameraError:
            # Photos without texture or overlap say nothing about their cameras.
            return camera_set
        model = posed_model(workspace, by_photo, np.eye(4))
        pairs = fit_of_pairs(model, workspace.database)
        names = {
            image_id: workspace.copy_of(model.image(image_id).name).photo.name for image_id in model.reg_image_ids()
        }

        def exchanged(a: int, b: int) -> tuple[PairFit, ...]:
            poses = {**by_photo, names[a]: by_photo[names[b]], names[b]: by_photo[names[a]]}
            return fit_of_pairs(posed_model(workspace, poses, np.eye(4)), workspace.database)

        wrong = set(refuted_images(pairs, exact=True))
        if are_refuted(pairs) and len(wrong) != 2:
            wrong = _exchanged_images(pairs, exchanged, should_stop) or wrong
    if len(wrong) < _KEPT_SHARE * len(names):
        # Of few photos, most pairs are those of two exchanged ones, which must not speak for the others.
        pairs = tuple(pair for pair in pairs if not wrong & {pair.first, pair.second})
    refuted = sorted(names[image_id] for image_id in wrong)
    evidence = Evidence(len(photo_set.photos), len(photos.photos), camera_set.reprojection_error, pairs=pairs)
    health = judge(evidence, poses_given=True, refuted=refuted)
    if health.colour != "green":
        emit(Warned(health.sentence))
    return _without_refuted(camera_set, health, len(photos.photos))


def _exchanged_images(
    pairs: Sequence[PairFit], exchanged: Callable[[int, int], Sequence[PairFit]], should_stop: StopCheck
) -> set[int]:
    """Return the two images whose exchange alone makes all photos agree with the cameras; none where no two do.

    Of few photos, two exchanged ones are partners of nearly all: these are refuted with them, or not even they.
    `exchanged` returns the pairs with the poses of two images exchanged. When `should_stop` returns True, the trials
    end without a finding.
    """
    found: dict[int, list[float]] = {}
    for pair in pairs:
        for image_id in (pair.first, pair.second):
            found.setdefault(image_id, []).append(pair.share)
    suspects = sorted(found, key=lambda image_id: (np.mean(found[image_id]), image_id))[:_SUSPECTS]
    right = []
    for a, b in combinations(sorted(suspects), 2):
        if should_stop():
            return set()
        if not are_refuted(exchanged(a, b)):
            right.append({a, b})
    # Several exchanges that explain it explain nothing.
    return right[0] if len(right) == 1 else set()


def _without_refuted(camera_set: CameraSet, health: CameraHealth, n_checked: int) -> CameraSet:
    refuted = set(health.refuted)
    if len(refuted) >= _KEPT_SHARE * n_checked:
        return dataclasses.replace(camera_set, health=health)
    return dataclasses.replace(
        camera_set,
        cameras=tuple(camera for camera in camera_set.cameras if camera.photo not in refuted),
        unregistered=tuple(sorted({*camera_set.unregistered, *refuted})),
        health=health,
    )
