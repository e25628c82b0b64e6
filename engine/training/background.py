"""The background: Gaussians on a sphere around the scene in the colours of the sky, or of another plain backdrop.

Structure from motion finds no points in a plain sky. Without a background, few Gaussians ever get there, and those that
do hang at any depth, before what other photos see. The sphere shows only what is plain, bright and far from all sparse
points; before black, everything else has to become solid. Its shape and colours are not trained, so that it cannot
explain what a single photo shows. See docs/training.md.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..core.arrays import Float32, Float64, Floats
from ..scene import Gaussians, PinholeCamera
from . import gaussians_at
from .held_out import in_threads
from .settings import TrainingSettings
from .start import initial_values
from .views import TrainingView, scene_extent

RADIUS = 30.0  # chosen on sakharov_statue32
"""Radius of the sphere around the mean camera, per extent: no parallax between the cameras, within reach of float32."""

OVERLAP = 0.8  # chosen on sakharov_statue32
"""Standard deviation of its Gaussians, in distances between neighbours, so that the sphere has no holes."""

OPACITY = 0.95
"""Opacity of its Gaussians."""

UNCOVERED_DISTANCE = 0.1  # chosen on sakharov_statue32, skull66, banana16
"""Distance to the nearest sparse point beyond which a pixel may show the background, as a fraction of the longest
side."""

WINDOW = 0.05
"""Width of the window in which a pixel must be plain, as a fraction of the longest side; its mean colour is read."""

MAX_DEVIATION = 10.0  # chosen on sakharov_statue32, skull66, banana16
"""Largest standard deviation of the brightness in the window of a plain pixel, of 255. Walls and carpets have more."""

MIN_BRIGHTNESS = 40.0
"""Smallest brightness of the background, of 255, as for pixels that count as dark when they are rendered black."""


def background_gaussians(points: Floats, views: Sequence[TrainingView], settings: TrainingSettings) -> Gaussians:
    """Return the Gaussians of the sphere that appear in plain areas of training photos, with their median colours.

    Parameters
    ----------
    points : array of shape [P, 3]
        Sparse points, world units.
    views : sequence of TrainingView
        Held-out ones are not used.

    Returns
    -------
    Gaussians
        No Gaussians where photos show no such areas.
    """
    training = [view for view in views if not view.held_out]
    cameras = [view.pinhole for view in training]
    radius = RADIUS * scene_extent(cameras)
    places = np.mean([camera.center for camera in cameras], axis=0) + radius * _directions(settings.growth.n_background)
    colors = np.full((len(training), len(places), 3), np.nan, np.float32)

    def look(seen: Float32, view: TrainingView) -> None:
        mean, plain = _plain(view)
        rows, pixels = _uncovered(places, points, view.pinhole)
        x, y = pixels.astype(int).T
        rows, x, y = (values[plain[y, x]] for values in (rows, x, y))
        seen[rows] = mean[y, x]

    in_threads(functools.partial(look, seen, view) for seen, view in zip(colors, training, strict=True))
    kept = np.isfinite(colors[..., 0]).any(axis=0)
    medians = np.nanmedian(colors[:, kept], axis=0).astype(np.float64)
    values = initial_values(settings, opacity=OPACITY)
    spacing = radius * np.sqrt(4.0 * np.pi / max(settings.growth.n_background, 1))
    return gaussians_at(
        places[kept], medians, np.full(len(medians), OVERLAP * spacing), values,
        rng=np.random.default_rng((settings.seed, 1)),
    )  # fmt: skip


def _directions(n: int) -> Float64:
    """Return `n` unit vectors that are spread evenly over the sphere, on a spiral of golden angles, [n, 3]."""
    index = np.arange(n) + 0.5
    z, angle = 1.0 - 2.0 * index / max(n, 1), np.pi * (1.0 + 5.0**0.5) * index
    ring = np.sqrt(1.0 - z * z)
    return np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])


def _plain(view: TrainingView) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the mean colours around the pixels, [h, w, 3], and which pixels are plain, bright and valid, [h, w]."""
    width = max(1, round(WINDOW * max(view.pinhole.width, view.pinhole.height)))
    colors = view.pixels.astype(np.float32)
    brightness = colors.mean(axis=2)
    mean, square = (cv2.blur(values, (width, width)) for values in (brightness, brightness**2))
    plain = (mean > MIN_BRIGHTNESS) & (square - mean**2 < MAX_DEVIATION**2)
    if view.valid is not None:
        plain &= view.valid
    return np.asarray(cv2.blur(colors, (width, width))), np.asarray(plain)


def _uncovered(places: Float64, points: Floats, camera: PinholeCamera) -> tuple[NDArray[np.intp], Float64]:
    """Return which of `places` appear far from all sparse points, and their pixels, [M, 2]."""
    rows, pixels, _ = camera.project(places)
    _, covered, _ = camera.project(points)
    if len(covered) and len(pixels):
        distance, _ = cKDTree(covered).query(pixels)
        far = distance > UNCOVERED_DISTANCE * max(camera.width, camera.height)
        rows, pixels = rows[far], pixels[far]
    return rows, pixels
