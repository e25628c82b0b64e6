"""Which way pictures were turned, decided by features that photos have in common, for models without coloured points.

For the right orientation of two photos, the rays of a feature that both show lie in one plane with the two cameras. The
angle of the second ray off that plane is the error of a match.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.arrays import Float64
from ..core.errors import CameraError
from ..core.events import Emit, StopCheck
from ..scene import Camera, PhotoSet
from .colmap_calls import opened_database, verified_pairs
from .features import match_posed_photos
from .orientation import GivenCamera, OrientationChoice
from .settings import CameraSettings
from .turning import MIRRORED
from .undistortion import require_valid_lens

_MIN_MATCHES = 12
"""Matches of a pair that count."""
_CLEAR_RATIO = 0.5
"""The error of the right orientation is at most this part of the errors of the others."""
_N_SWEEPS = 3


class _Pair(NamedTuple):
    """Matched features of two photos, by the indices of their cameras, in pixels [M, 2] of the upright photos."""

    first: int
    second: int
    at_first: Float64
    at_second: Float64


def orientations_by_matches(
    given: Sequence[GivenCamera],
    choice: OrientationChoice,
    model: Path,
    photo_set: PhotoSet,
    settings: CameraSettings,
    folder: Path,
    *,
    emit: Emit,
    should_stop: StopCheck,
) -> list[int]:
    """Return the orientation of each camera where `choice` leaves some open.

    Parameters
    ----------
    model : Path
        For messages.
    folder : Path
        Work folder of the matching.
    emit, should_stop
        As in `estimate_cameras`.

    Raises
    ------
    CameraError
        When the matches do not decide either.
    Cancelled
        When `should_stop` returned True.
    """
    guessed = [camera.upright(one) for camera, one in zip(given, choice.chosen, strict=True)]
    pairs = _matches(guessed, photo_set, settings, folder, emit, should_stop)
    chosen, problem = choice.chosen, None
    best_error = np.inf
    for start in _starts(choice):
        found, error, unclear = _decided(given, choice.open, start, pairs)
        if error < best_error:
            best_error, chosen, problem = error, found, unclear
    if problem is not None:
        raise CameraError(
            f"It cannot be found out whether {model} has the camera of {given[problem].photo.name} for the upright "
            "photo or for the picture as its file stores it. Save the photos without EXIF rotation, or let the cameras "
            "be estimated."
        )
    return chosen


def _starts(choice: OrientationChoice) -> list[list[int]]:
    """Return the first guesses: all open cameras with their first option (upright), and all with their last."""
    starts = []
    for which in (0, -1):
        start = list(choice.chosen)
        for index, options in choice.open.items():
            start[index] = options[which]
        starts.append(start)
    return starts


def _decided(
    given: Sequence[GivenCamera], options: dict[int, tuple[int, ...]], start: list[int], pairs: Sequence[_Pair]
) -> tuple[list[int], float, int | None]:
    """Return the orientations that fit best, their error, and a camera whose options fit equally well, if any."""
    chosen = list(start)
    errors: dict[int, dict[int, float]] = {}
    for _ in range(_N_SWEEPS):
        before = list(chosen)
        for index, possible in options.items():
            of_camera = [pair for pair in pairs if index in (pair.first, pair.second)]
            trials = {one: [*chosen[:index], one, *chosen[index + 1 :]] for one in possible}
            errors[index] = {one: _error(given, trial, of_camera) for one, trial in trials.items()}
            chosen[index] = min(possible, key=errors[index].__getitem__)
        if chosen == before:
            break
    unclear = None
    for index, found in errors.items():
        lowest, *others = sorted(found.values())
        if not np.isfinite(lowest) or (others and lowest > _CLEAR_RATIO * others[0]):
            unclear = index
    return chosen, _error(given, chosen, pairs), unclear


def _error(given: Sequence[GivenCamera], chosen: Sequence[int], pairs: Sequence[_Pair]) -> float:
    """Return the median over the pairs of their median error in radians; infinite without pairs."""
    errors = [_error_of(given, chosen, pair) for pair in pairs]
    return float(np.median(errors)) if errors else np.inf


def _error_of(given: Sequence[GivenCamera], chosen: Sequence[int], pair: _Pair) -> float:
    if (chosen[pair.first] in MIRRORED) != (chosen[pair.second] in MIRRORED):
        return float(np.pi)
    cameras = [given[index].upright(chosen[index]) for index in (pair.first, pair.second)]
    rays = [_rays(camera, at) for camera, at in zip(cameras, (pair.at_first, pair.at_second), strict=True)]
    baseline = cameras[1].center - cameras[0].center
    normals = np.cross(baseline, rays[0])
    lengths = np.linalg.norm(normals, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(np.einsum("mi,mi->m", normals, rays[1])) / lengths
    return float(np.nanmedian(np.arcsin(np.clip(off, 0.0, 1.0)))) if np.isfinite(off).any() else np.inf


def _rays(camera: Camera, pixels: Float64) -> Float64:
    """Return unit vectors [M, 3] in the world from the camera to what pixels show."""
    directions = np.asarray(require_valid_lens(camera.lens).cam_from_img(pixels), np.float64)
    rays = np.concatenate([directions, np.ones((len(directions), 1))], axis=1) @ camera.viewmat[:3, :3]
    unit: Float64 = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return unit


def _matches(
    cameras: Sequence[Camera],
    photo_set: PhotoSet,
    settings: CameraSettings,
    folder: Path,
    emit: Emit,
    should_stop: StopCheck,
) -> list[_Pair]:
    """Return the verified matches of the photos."""
    # With the guessed lenses: if the guess is right, `triangulate` continues with these features.
    workspace = match_posed_photos(cameras, photo_set, settings, folder, emit=emit, should_stop=should_stop)
    index_of = {camera.photo: index for index, camera in enumerate(cameras)}
    pairs = []
    with opened_database(workspace.database) as database:
        names = {image.image_id: image.name for image in database.read_all_images()}
        keypoints: dict[int, Float64] = {}
        for image_id, name in names.items():
            copy = workspace.copy_of(name)
            scale = (copy.photo.width / copy.width, copy.photo.height / copy.height)
            keypoints[image_id] = np.asarray(database.read_keypoints(image_id), np.float64)[:, :2] * scale
        for first, second, _ in verified_pairs(database, _MIN_MATCHES):
            rows = np.asarray(database.read_two_view_geometry(first, second).inlier_matches)
            ends = [index_of[workspace.copy_of(names[one]).photo.name] for one in (first, second)]
            pairs.append(_Pair(ends[0], ends[1], keypoints[first][rows[:, 0]], keypoints[second][rows[:, 1]]))
    return pairs
