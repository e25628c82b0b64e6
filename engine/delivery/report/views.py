"""Pictures of the report: test photos with their renders, and objects from several sides."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...cameras import covering_pinhole, is_point_visible, training_pinhole, undistort
from ...core.files import path_within
from ...masks import feature_agreement
from ...objects import spread_cameras
from ...pictures import Scene, render_view
from ...rasterizer.settings import Backend
from ...scene import Camera, Gaussians, PinholeCamera
from ...training import WELL_SEEN, Coverage
from .sheet import render_alone

_PAIR_SIDE = 760
"""Longest side of a photo and its render, pixels."""
_PALE = 160
"""Least brightness, of 255, of places that few photos saw."""
_ORBIT_SIDE = 360
"""Side of the picture of an object, pixels."""
_FIELD_OF_VIEW = np.radians(35.0)
"""Field of view of the pictures of objects."""
_MAX_ELEVATION = np.radians(60.0)
"""Largest elevation of the cameras around an object, up or down."""
_VISIBILITY_SIDE = 160
"""Longest side of the renders in which the visible pixels of objects are counted, pixels."""
_MAX_PHOTOS = 24
"""Photos in which the visible pixels of an object are counted."""
_MIN_VISIBLE_RATIO = 0.9
"""A photo shows an object whole when it shows at least this part of what the best photo shows."""
_MIN_ARC = np.radians(40.0)
"""Smallest angle about the vertical axis that the cameras around an object span."""


@dataclass(frozen=True)
class PhotoPair:
    """A photo and a render from its camera, without lens distortion, uint8 [H, W, 3].

    Attributes
    ----------
    photo, render : array of shape [H, W, 3], uint8
    marked : array of shape [H, W, 3], uint8
        The render, in pale grey where it shows what fewer than three training photos see.
    """

    photo: NDArray[np.uint8]
    render: NDArray[np.uint8]
    marked: NDArray[np.uint8]


def photo_pair(
    folder: Path, camera: Camera, gaussians: Gaussians, coverage: Coverage, *, backend: Backend = "cpu"
) -> Callable[[], PhotoPair]:
    """Render what a photo shows, and return what reads the photo and returns both, which any thread may call.

    Parameters
    ----------
    folder : Path
        The photo folder.
    coverage : Coverage
        Of the training photos.
    backend : {"cpu", "gpu", "reference"}

    Raises
    ------
    PhotoError
        By what is returned, when the photo can no longer be read.
    FormatError
        By the same, when its name leads out of the folder.
    """
    from ...photos import load_pixels

    frame = training_pinhole(camera, max_side=_PAIR_SIDE)
    render, count = render_view(gaussians, frame, backend=backend), coverage.counting(frame)

    def pair() -> PhotoPair:
        pixels = load_pixels(path_within(folder, camera.photo), max_side=2 * _PAIR_SIDE)
        photo = np.asarray(undistort(pixels, camera, frame, interpolation="linear"), np.uint8)
        pale = np.repeat((render.mean(axis=2, keepdims=True) / 3 + _PALE).astype(np.uint8), 3, axis=2)
        few = count() < WELL_SEEN
        return PhotoPair(photo, render, np.where(few[..., None], pale, render))

    return pair


def best_seen_from(scene: Scene, members: Sequence[NDArray[np.bool_]], cameras: Sequence[Camera]) -> list[list[Camera]]:
    """Return for each object the cameras that see almost as much of it as the camera that sees most.

    Parameters
    ----------
    members : sequence of bool arrays of shape [N]
        The objects.

    Returns
    -------
    list of list of Camera
        Chosen among at most 24 spread cameras whose picture contains the centre of the object. A camera is returned
        when the visible share of the object, which other Gaussians and the picture's border reduce, is at least nine
        tenths of the largest. Empty for an object that no picture shows.
    """
    alone_in = [scene.with_gaussians(scene.gaussians[one]) for one in members]
    candidates: list[set[str]] = []
    for one in alone_in:
        middle = np.median(one.gaussians.means, axis=0) if len(one) else None
        facing = [camera for camera in cameras if middle is not None and is_point_visible(camera, middle)]
        candidates.append({camera.photo for camera in spread_cameras(facing, _MAX_PHOTOS)})
    parts: list[dict[str, float]] = [{} for _ in members]
    for camera in cameras:
        frame = covering_pinhole(camera, max_side=_VISIBILITY_SIDE)
        wanted = [i for i, photos in enumerate(candidates) if camera.photo in photos]
        if not wanted:
            continue
        among = np.column_stack([members[i] for i in wanted]).astype(np.float32)
        seen = scene.render(frame, color=True, channels=among).channels[..., 3:].sum(axis=(0, 1))
        for i, pixels in zip(wanted, seen.tolist(), strict=True):
            parts[i][camera.photo] = pixels / max(1.0, _covered(alone_in[i], frame))
    least = [_MIN_VISIBLE_RATIO * max(shares.values(), default=0.0) for shares in parts]
    return [
        [camera for camera in cameras if shares.get(camera.photo, 0.0) >= enough > 0]
        for shares, enough in zip(parts, least, strict=True)
    ]


def _covered(alone_in: Scene, frame: PinholeCamera) -> float:
    """Return how many pixels the object alone covers, counted up to half a picture beyond the borders."""
    K = frame.K.copy()
    K[:2, 2] += (frame.width / 2, frame.height / 2)
    around = PinholeCamera(frame.viewmat, K, 2 * frame.width, 2 * frame.height)
    return float(alone_in.render(around, color=True).alpha.sum())


def orbit_cameras(
    points: NDArray[np.floating], cameras: Sequence[Camera], *, count: int = 4, side: int = _ORBIT_SIDE
) -> list[PinholeCamera]:
    """Return cameras around an object, on the sides from which it was photographed.

    Parameters
    ----------
    points : array of shape [M, 3], float
        Centres of the object's Gaussians, at least one; world units, Z up.
    cameras : sequence of Camera
        Cameras of the photos that see the object. If those whose picture contains its centre surround it, so do the
        returned ones; else these span the angles between the 10th and 90th percentile of those cameras, at least 40
        degrees, since no photo shows the back of a shield on a wall. Their elevation is the median of the photos'.
    side : int
        Width and height of the pictures, pixels.

    Returns
    -------
    list of PinholeCamera
    """
    low, high = np.percentile(points, [2, 98], axis=0)
    center = (low + high) / 2
    radius = max(float(np.linalg.norm(high - low)) / 2, 1e-3)
    distance = 1.25 * radius / np.sin(_FIELD_OF_VIEW / 2)
    facing = [camera for camera in cameras if is_point_visible(camera, center)]
    away = np.array([camera.center - center for camera in facing or cameras]).reshape(-1, 3)
    sides = away[:, :2] / np.maximum(np.linalg.norm(away[:, :2], axis=1, keepdims=True), 1e-9)
    mean = sides.mean(axis=0) if len(sides) else np.zeros(2)
    front = float(np.arctan2(mean[1], mean[0]))
    if np.linalg.norm(mean) < 0.3:
        angles = front + 2 * np.pi * np.arange(count) / count
    else:
        from_front = np.angle(np.exp(1j * (np.arctan2(sides[:, 1], sides[:, 0]) - front)))
        first, last = np.percentile(from_front, [10, 90])
        wider = max(0.0, _MIN_ARC - (last - first)) / 2
        first, last = first - wider, last + wider
        angles = front + np.linspace(first, last, count)
    above = np.arctan2(away[:, 2], np.linalg.norm(away[:, :2], axis=1))
    elevation = float(np.clip(np.median(above), -_MAX_ELEVATION, _MAX_ELEVATION)) if len(away) else 0.0
    focal = side / 2 / np.tan(_FIELD_OF_VIEW / 2)
    K = np.array([[focal, 0, side / 2], [0, focal, side / 2], [0, 0, 1.0]])
    viewmats = [_look_at(center, distance, angle, elevation) for angle in angles]
    return [PinholeCamera(viewmat, K, side, side) for viewmat in viewmats]


def _look_at(center: NDArray[np.floating], distance: float, angle: float, elevation: float) -> NDArray[np.float64]:
    """Return the world-to-camera matrix that looks at `center` from `angle` about Z and from `elevation`."""
    away = np.array([np.cos(angle) * np.cos(elevation), np.sin(angle) * np.cos(elevation), np.sin(elevation)])
    forward = -away
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    viewmat = np.eye(4)
    viewmat[:3, :3] = rotation
    viewmat[:3, 3] = -rotation @ (center + distance * away)
    return viewmat


def orbit_pictures(
    gaussians: Gaussians, cameras: Sequence[Camera], *, backend: Backend = "cpu"
) -> list[NDArray[np.uint8]]:
    """Return pictures of an object alone from several sides, each uint8 [H, W, 3]; none without Gaussians."""
    if len(gaussians) == 0:
        return []
    scene, sides = Scene(gaussians, backend=backend), orbit_cameras(gaussians.means, cameras)
    return [render_alone(scene, camera) for camera in sides]


def measure_feature_agreement(
    gaussians: Gaussians,
    views: Iterable[tuple[Camera, NDArray[np.int32]]],
    *,
    backend: Backend = "cpu",
) -> dict[str, float] | None:
    """Return how well features reproduce SAM segments of photos, and how well random features do.

    Parameters
    ----------
    views : iterable of (Camera, int32 array of shape [h, w])
        Test photos with their label maps.
    backend : {"cpu", "gpu", "reference"}

    Returns
    -------
    dict with ``trained`` and ``untrained``, mean IoU of the segments, or None without features or label maps.
    """
    if gaussians.features is None:
        return None
    random = np.random.default_rng(0).normal(size=gaussians.features.shape).astype(np.float32)
    scene = Scene(gaussians, backend=backend)
    scores: dict[str, list[float]] = {"trained": [], "untrained": []}
    for camera, labels in views:
        frame = training_pinhole(camera, max_side=480)
        segments = np.asarray(undistort(labels, camera, frame, interpolation="nearest"), np.int32)
        for name, features in (("trained", gaussians.features), ("untrained", random)):
            rendered = scene.render(frame, channels=features)
            score = feature_agreement(rendered.channels, segments, alpha=rendered.alpha)
            if np.isfinite(score):
                scores[name].append(score)
    if not scores["trained"]:
        return None
    return {name: float(np.mean(values)) for name, values in scores.items()}
