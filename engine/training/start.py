"""The Gaussians a training run starts from: sparse points, and guesses where the photos show none."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..events import Emit
from ..gaussians import gaussians_at, gaussians_from_points
from ..scene import FEATURE_DIM, CameraSet, Gaussians, PinholeCamera
from .settings import TrainingSettings
from .views import TrainingView

__all__ = ["guess_uncovered", "start_gaussians"]

Float64 = NDArray[np.float64]
_FEWEST_POINTS = 30
"""In a photo; with fewer, their depth says nothing."""
_UNCOVERED = 0.02
"""A pixel is uncovered when no sparse point lies within this part of the picture's longest side."""
_BLACK = 10
"""Of 255 in all colours: nothing is black already, a guess there would stand before what is seen from elsewhere."""
_DEPTHS = (4.0, 100.0)
"""Of guesses, in median depths of the photo's points: what shows no points mostly lies behind what does."""
_BLUR = 5
_NEAREST, _MOST_OF_THEM, _ALIKE = 8, 6, 20
"""A pixel lies on the surface of the sparse points around it when 6 of the 8 nearest differ in colour by less than 20
of 255, in a picture blurred over 5 pixels: carpet between carpet, but not sky beside a roof."""


def start_gaussians(
    camera_set: CameraSet, views: Sequence[TrainingView], settings: TrainingSettings, *, emit: Emit
) -> Gaussians:
    """Return Gaussians at the sparse points and where the training photos show none, as `settings` ask for.

    Parameters
    ----------
    camera_set : CameraSet
        Its points may be few or none.
    views : sequence of TrainingView
        Held-out ones are not looked at.
    settings : TrainingSettings
    emit : Emit
        Gets a warning when points had to be invented.

    Raises
    ------
    TrainingError
        When there is neither a point nor a photo to train on.
    """
    training = [view for view in views if not view.held_out]
    points = camera_set.points.astype(np.float64)
    feature_dim = FEATURE_DIM if settings.features else None
    n_guesses = min(int(settings.background * settings.max_gaussians), settings.max_gaussians - len(points))
    rng = np.random.default_rng((settings.seed, 1))
    guesses = guess_uncovered(training, points, max(n_guesses, 0), rng)
    start = gaussians_from_points(
        points,
        camera_set.point_colors,
        sh_degree=settings.sh_degree,
        feature_dim=feature_dim,
        seed=settings.seed,
        max_gaussians=settings.max_gaussians - len(guesses[0]),
        cameras=[view.pinhole for view in training],
        opacity=settings.start_opacity,
        feature_init=settings.feature_init,
        emit=emit,
    )
    behind = gaussians_at(
        *guesses,
        sh_degree=settings.sh_degree,
        feature_dim=feature_dim,
        rng=rng,
        opacity=settings.start_opacity,
        feature_init=settings.feature_init,
    )
    return start.joined(behind)


def guess_uncovered(
    views: Sequence[TrainingView], points: Float64, n: int, rng: np.random.Generator
) -> tuple[Float64, Float64, Float64]:
    """Return about `n` points for pixels that count, are not black and have no sparse point near, colours and scales.

    Each lies on its pixel's ray: as deep as the sparse points around it where most look like it, else far behind, at 4
    to 100 times the median depth of the photo's points (evenly in 1 / depth), for what only one or two photos show
    (sky, a far street) cannot be placed by training: too near, it looks right in those alone. It is as large as the
    guesses of its photo are apart, so that they cover what they stand for and nothing else has to. Before a plain sky,
    guesses as small as sparse points left floaters over 80 % of what nearer cameras saw, these 1 %, and the photos held
    out gained 14 dB; `preview` of a statue before a street 18.5 to 20.6 dB, of bananas on a carpet 25.6 to 25.8 (all of
    it far behind: 22.5), of a room 27.0 and 26.9.

    Parameters
    ----------
    views : sequence of TrainingView
    points : array of shape [P, 3]
        Sparse points, world units.
    n : int
        Fewer are returned where little is uncovered.
    rng : numpy.random.Generator

    Returns
    -------
    points : array of shape [M, 3], float64
    colors : array of shape [M, 3], float64
        0 to 255.
    scales : array of shape [M], float64
        World units: those of one photo cover what it shows no points of.
    """
    places, tints, sizes = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty(0)]
    for view in views if n > 0 else ():
        camera, wanted = view.pinhole, -(-n // len(views))
        pixels, depths = _pixels_of(points, camera)
        if len(pixels) < _FEWEST_POINTS:
            continue
        drawn = rng.random((4 * wanted, 2)) * (camera.width, camera.height)
        distance, nearest = cKDTree(pixels).query(drawn, k=_NEAREST)
        colors = _colors_at(drawn, view.pixels)
        counts = colors.max(axis=1) > _BLACK
        if view.valid is not None:
            x, y = drawn.astype(int).T
            counts &= view.valid[y, x]
        uncovered = np.flatnonzero(counts & (distance[:, 0] > _UNCOVERED * max(camera.width, camera.height)))
        share = len(uncovered) / len(drawn)
        uncovered = uncovered[:wanted]
        drawn, nearest = drawn[uncovered], nearest[uncovered]
        smooth = cv2.blur(view.pixels, (_BLUR, _BLUR))
        differ = np.abs(_colors_at(pixels, smooth)[nearest] - _colors_at(drawn, smooth)[:, None]).max(axis=2)
        around = (differ < _ALIKE).sum(axis=1) >= _MOST_OF_THEM
        behind = np.median(depths) / rng.uniform(1.0 / _DEPTHS[1], 1.0 / _DEPTHS[0], size=len(drawn))
        depth = np.where(around, np.median(depths[nearest], axis=1), behind)
        rays = (drawn - camera.K[:2, 2]) / camera.K[[0, 1], [0, 1]]
        local = np.column_stack([rays, np.ones(len(rays))]) * depth[:, None]
        places.append((local - camera.viewmat[:3, 3]) @ camera.viewmat[:3, :3])
        tints.append(colors[uncovered])
        apart = np.sqrt(share * camera.width * camera.height / max(len(drawn), 1))
        sizes.append(apart / camera.K[0, 0] * depth)
    return np.concatenate(places)[:n], np.concatenate(tints)[:n], np.concatenate(sizes)[:n]


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
