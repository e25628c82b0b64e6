"""The initial Gaussians of a training run: at the sparse points, and guesses where the photos show no points."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..events import Emit
from ..gaussians import InitialValues, gaussians_at, gaussians_from_points
from ..scene import FEATURE_DIM, CameraSet, Gaussians, PinholeCamera
from .settings import TrainingSettings
from .views import TrainingView

__all__ = ["guess_uncovered", "start_gaussians"]

Float64 = NDArray[np.float64]
MIN_POINTS_IN_PHOTO = 30  # chosen on museum_room
"""Smallest number of sparse points in a photo; with fewer, their depths are not representative."""

UNCOVERED_DISTANCE = 0.02  # chosen on museum_room
"""Distance to the nearest sparse point beyond which a pixel is uncovered, as a fraction of the longest side."""

MAX_BLACK = 10  # chosen on stability_scenes
"""Largest value of a black pixel in each colour, of 255. Empty space is rendered black, so a black pixel needs no
guess, which would occlude what other cameras see."""

FAR_DEPTHS = (4.0, 100.0)  # chosen on museum_room
"""Range of depths of far guesses, in median depths of the points of the photo. Areas without points are mostly behind
those with points."""

BLUR_PIXELS = 5  # chosen on museum_room, sakharov_statue32, banana16, sky_scene
"""Width of the blur before colours are compared, pixels."""

N_NEAREST_POINTS = 8  # chosen on museum_room, sakharov_statue32, banana16, sky_scene
"""Sparse points around a pixel whose colours are compared with its own."""

MIN_SIMILAR_POINTS = 6  # chosen on museum_room, sakharov_statue32, banana16, sky_scene
"""Number of these points with a similar colour for which a pixel lies on their surface: on a carpet between points of
the carpet, but not in the sky beside a roof."""

MAX_COLOR_DIFFERENCE = 20  # chosen on museum_room, sakharov_statue32, banana16, sky_scene
"""Largest difference of similar colours in each channel, of 255."""


def start_gaussians(
    camera_set: CameraSet, views: Sequence[TrainingView], settings: TrainingSettings, *, emit: Emit
) -> Gaussians:
    """Return Gaussians at the sparse points and where the training photos show none.

    Parameters
    ----------
    camera_set : CameraSet
        Cameras and sparse points, of which there may be none.
    views : sequence of TrainingView
        Held-out ones are not used.
    settings : TrainingSettings
    emit : Emit
        Receives a warning when random points had to be added.

    Raises
    ------
    TrainingError
        When there are neither points nor photos to train on.
    """
    training = [view for view in views if not view.held_out]
    points = camera_set.points.astype(np.float64)
    growth = settings.growth
    feature_dim = FEATURE_DIM if settings.features.train_features else None
    n_guesses = min(int(growth.background_fraction * growth.max_gaussians), growth.max_gaussians - len(points))
    rng = np.random.default_rng((settings.seed, 1))
    guesses = guess_uncovered(training, points, max(n_guesses, 0), rng)
    values = InitialValues(
        settings.appearance.sh_degree, feature_dim, growth.start_opacity, settings.features.feature_init
    )
    start = gaussians_from_points(
        points,
        camera_set.point_colors,
        values,
        seed=settings.seed,
        max_gaussians=growth.max_gaussians - len(guesses[0]),
        cameras=[view.pinhole for view in training],
        emit=emit,
    )
    return start.joined(gaussians_at(*guesses, values, rng=rng))


def guess_uncovered(
    views: Sequence[TrainingView], points: Float64, n: int, rng: np.random.Generator
) -> tuple[Float64, Float64, Float64]:
    """Return about `n` points for pixels that are valid, not black and far from all sparse points.

    Each guess lies on the ray of its pixel. Its depth is that of the sparse points around it where most of them have a
    similar colour. Otherwise it is far behind, at 4 to 100 times the median depth of the photo's points, evenly in
    1 / depth: training cannot place what only one or two photos show, such as sky or a distant street, and too near
    it would look right in those photos only. A guess is as large as the distance between the guesses of its photo, so
    that these cover the area. See docs/design_notes/training.md.

    Parameters
    ----------
    views : sequence of TrainingView
    points : array of shape [P, 3]
        Sparse points, world units.
    n : int
        Number of points; fewer are returned where little is uncovered.
    rng : numpy.random.Generator

    Returns
    -------
    points : array of shape [M, 3], float64
    colors : array of shape [M, 3], float64
        Colours, 0 to 255.
    scales : array of shape [M], float64
        Sizes, world units.
    """
    positions, colors, scales = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty(0)]
    for view in views if n > 0 else ():
        camera, n_wanted = view.pinhole, -(-n // len(views))
        pixels, depths = _pixels_of(points, camera)
        if len(pixels) < MIN_POINTS_IN_PHOTO:
            continue
        drawn = rng.random((4 * n_wanted, 2)) * (camera.width, camera.height)
        distance, nearest = cKDTree(pixels).query(drawn, k=N_NEAREST_POINTS)
        drawn_colors = _colors_at(drawn, view.pixels)
        usable = drawn_colors.max(axis=1) > MAX_BLACK
        if view.valid is not None:
            x, y = drawn.astype(int).T
            usable &= view.valid[y, x]
        uncovered = np.flatnonzero(usable & (distance[:, 0] > UNCOVERED_DISTANCE * max(camera.width, camera.height)))
        share = len(uncovered) / len(drawn)
        uncovered = uncovered[:n_wanted]
        drawn, nearest = drawn[uncovered], nearest[uncovered]
        smooth = cv2.blur(view.pixels, (BLUR_PIXELS, BLUR_PIXELS))
        difference = np.abs(_colors_at(pixels, smooth)[nearest] - _colors_at(drawn, smooth)[:, None]).max(axis=2)
        on_surface = (difference < MAX_COLOR_DIFFERENCE).sum(axis=1) >= MIN_SIMILAR_POINTS
        far_depth = np.median(depths) / rng.uniform(1.0 / FAR_DEPTHS[1], 1.0 / FAR_DEPTHS[0], size=len(drawn))
        depth = np.where(on_surface, np.median(depths[nearest], axis=1), far_depth)
        rays = (drawn - camera.K[:2, 2]) / camera.K[[0, 1], [0, 1]]
        local = np.column_stack([rays, np.ones(len(rays))]) * depth[:, None]
        positions.append((local - camera.viewmat[:3, 3]) @ camera.viewmat[:3, :3])
        colors.append(drawn_colors[uncovered])
        spacing = np.sqrt(share * camera.width * camera.height / max(len(drawn), 1))
        scales.append(spacing / camera.K[0, 0] * depth)
    return np.concatenate(positions)[:n], np.concatenate(colors)[:n], np.concatenate(scales)[:n]


def _colors_at(places: Float64, picture: NDArray[np.uint8]) -> Float64:
    """Return the colours, 0 to 255, of the pixels at `places` [M, 2]."""
    x, y = places.astype(int).T
    return picture[y, x].astype(np.float64)


def _pixels_of(points: Float64, camera: PinholeCamera) -> tuple[Float64, Float64]:
    """Return pixels [M, 2] and depths [M] of the points that lie in the picture."""
    local = points @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    local = local[local[:, 2] > 1e-6]
    pixels = local[:, :2] / local[:, 2:] * camera.K[[0, 1], [0, 1]] + camera.K[:2, 2]
    inside = ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(axis=1)
    return pixels[inside], local[inside, 2]
