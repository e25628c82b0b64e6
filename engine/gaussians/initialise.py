"""Gaussians to start training from: one at each sparse point, or scattered in the cameras' view where none are.

Kerbl et al. 2023, section 5.1: isotropic, as large as the mean distance to the three nearest neighbours.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from ..errors import TrainingError
from ..events import Emit, Warned, ignore_events
from ..formats import SH_C0
from ..scene import Gaussians, PinholeCamera

__all__ = ["gaussians_at", "gaussians_from_points", "initial_features", "points_in_view"]

logger = logging.getLogger(__name__)

Float64 = NDArray[np.float64]
FeatureInit = Literal["unit", "paper"]

_FEWEST_POINTS = 500
"""Below this the photos' surface is too thinly covered to grow from; points are scattered around those there are."""
_NEIGHBOURS = 3
_LARGEST_SCALE = 8.0
"""In median spacings: a lone outlier must not start as a curtain before every camera."""
_SMALLEST_SCALE = 0.05


def gaussians_from_points(
    points: ArrayLike,
    colors: ArrayLike,
    *,
    sh_degree: int,
    feature_dim: int | None,
    seed: int,
    max_gaussians: int,
    cameras: Sequence[PinholeCamera] = (),
    opacity: float = 0.3,
    feature_init: FeatureInit = "unit",
    emit: Emit = ignore_events,
) -> Gaussians:
    """Return Gaussians at sparse `points`, with neutral view dependence and random features.

    Parameters
    ----------
    points : array of shape [P, 3]
        Sparse points, world units. Duplicates and rows that are not finite are left out.
    colors : array of shape [P, 3], uint8
        sRGB.
    sh_degree : int
        0 to 3; the higher bands start at zero.
    feature_dim : int or None
        Length of the segmentation feature, None for none.
    seed : int
        Of every random draw here.
    max_gaussians : int
        Of more points, this many are drawn at random.
    cameras : sequence of PinholeCamera
        Where to look for a scene when there are few points or none.
    opacity : float
        Of every Gaussian, 0.1 to 0.5 works.
    feature_init : {"unit", "paper"}
        See `initial_features`.
    emit : Emit
        Gets a warning when points had to be invented.

    Returns
    -------
    Gaussians

    Raises
    ------
    TrainingError
        When there is neither a point nor a camera.
    """
    rng = np.random.default_rng(seed)
    places, tints = _usable_points(points, colors)
    if len(places) == 0:
        places, tints = _scattered_in_view(cameras, max_gaussians, rng, emit)
    elif len(places) > max_gaussians:
        kept = np.sort(rng.choice(len(places), max_gaussians, replace=False))
        places, tints = places[kept], tints[kept]
    elif len(places) < min(_FEWEST_POINTS, max_gaussians):
        places, tints = _thickened(places, tints, min(_FEWEST_POINTS, max_gaussians), cameras, rng, emit)
    return gaussians_at(
        places,
        tints,
        _spacing(places),
        sh_degree=sh_degree,
        feature_dim=feature_dim,
        rng=rng,
        opacity=opacity,
        feature_init=feature_init,
    )


def gaussians_at(
    places: Float64,
    colors: Float64,
    scales: Float64,
    *,
    sh_degree: int,
    feature_dim: int | None,
    opacity: float,
    feature_init: FeatureInit,
    rng: np.random.Generator,
) -> Gaussians:
    """Return one round Gaussian at each of `places`, with neutral view dependence and random features.

    Parameters
    ----------
    places : array of shape [N, 3]
        World units.
    colors : array of shape [N, 3]
        sRGB, 0 to 255.
    scales : array of shape [N]
        Standard deviations, world units.
    sh_degree, feature_dim, opacity, feature_init
        See `gaussians_from_points`.
    rng : numpy.random.Generator
        Source of the draws.
    """
    n = len(places)
    sh = np.zeros((n, (sh_degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = (colors / 255.0 - 0.5) / SH_C0
    quats = rng.normal(size=(n, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    return Gaussians(
        means=places.astype(np.float32),
        log_scales=np.repeat(np.log(scales).astype(np.float32)[:, None], 3, axis=1),
        quats=quats.astype(np.float32),
        opacity_logits=np.full(n, np.log(opacity / (1.0 - opacity)), np.float32),
        sh=sh,
        features=None if feature_dim is None else initial_features(n, feature_dim, rng, feature_init),
    )


def initial_features(n: int, dim: int, rng: np.random.Generator, init: FeatureInit) -> NDArray[np.float32]:
    """Return random features of shape [n, dim].

    Parameters
    ----------
    n, dim : int
        Shape.
    rng : numpy.random.Generator
        Source of the draws.
    init : {"unit", "paper"}
        ``unit``: uniform on the unit sphere. ``paper``: each entry ``(u - 0.5) / 0.28209`` with u in [0, 1), as in the
        released code of Dahaghin et al. 2024.
    """
    if init == "paper":
        return ((rng.random((n, dim)) - 0.5) / SH_C0).astype(np.float32)
    features = rng.normal(size=(n, dim))
    return (features / np.linalg.norm(features, axis=1, keepdims=True)).astype(np.float32)


def points_in_view(
    cameras: Sequence[PinholeCamera],
    n: int,
    rng: np.random.Generator,
) -> Float64:
    """Return `n` random points inside the cameras' view, shape [n, 3].

    Depths run from 0.3 to 2.5 times the distance between a camera and the point that all cameras look at
    best, evenly in 1 / depth, which is how finely a camera sees depth.
    """
    focus = _focus(cameras)
    chosen = rng.integers(len(cameras), size=n)
    points = np.empty((n, 3))
    for index, camera in enumerate(cameras):
        mine = np.flatnonzero(chosen == index)
        distance = max(float(np.linalg.norm(camera.center - focus)), 1e-3)
        depth = 1.0 / rng.uniform(1.0 / (2.5 * distance), 1.0 / (0.3 * distance), size=len(mine))
        pixels = rng.random((len(mine), 2)) * (camera.width, camera.height)
        rays = np.column_stack([(pixels - camera.K[:2, 2]) / camera.K[[0, 1], [0, 1]], np.ones(len(mine))])
        points[mine] = (rays * depth[:, None] - camera.viewmat[:3, 3]) @ camera.viewmat[:3, :3]
    return points


def _focus(cameras: Sequence[PinholeCamera]) -> Float64:
    """Return the point nearest to all optical axes; for axes that are (nearly) parallel, one in front of them."""
    axes = np.stack([camera.viewmat[2, :3] for camera in cameras])
    centers = np.stack([camera.center for camera in cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    # The weak pull to one unit in front of the cameras decides where the axes do not.
    pull = 1e-3 * len(cameras)
    prior = (centers + axes).mean(axis=0)
    focus: Float64 = np.linalg.solve(
        across.sum(axis=0) + pull * np.eye(3), (across @ centers[:, :, None]).sum(axis=0)[:, 0] + pull * prior
    )
    return focus


def _usable_points(points: ArrayLike, colors: ArrayLike) -> tuple[Float64, Float64]:
    places = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    tints = np.asarray(colors, dtype=np.float64).reshape(-1, 3)
    if len(places) != len(tints):
        raise ValueError(f"{len(places)} points and {len(tints)} colours")
    finite = np.isfinite(places).all(axis=1)
    if not finite.all():
        logger.warning("%d sparse points are not finite and were left out", int((~finite).sum()))
    places, tints = places[finite], tints[finite]
    _, first = np.unique(places.astype(np.float32), axis=0, return_index=True)
    kept = np.sort(first)
    return places[kept], tints[kept]


def _scattered_in_view(
    cameras: Sequence[PinholeCamera], max_gaussians: int, rng: np.random.Generator, emit: Emit
) -> tuple[Float64, Float64]:
    if not cameras:
        raise TrainingError(
            "There are no sparse points and no cameras to train from. Take more photos that overlap, then run again."
        )
    n = min(max_gaussians, 5000)
    emit(Warned(f"No sparse points were found; training starts from {n} random ones, which needs more steps."))
    return points_in_view(cameras, n, rng), np.full((n, 3), 127.5)


def _thickened(
    places: Float64,
    tints: Float64,
    wanted: int,
    cameras: Sequence[PinholeCamera],
    rng: np.random.Generator,
    emit: Emit,
) -> tuple[Float64, Float64]:
    """Return the points and, up to `wanted`, random ones around them (half in view, where cameras are known)."""
    n = wanted - len(places)
    emit(Warned(f"Only {len(places)} sparse points were found; {n} random ones were added around them."))
    n_view = n // 2 if cameras else 0
    base = rng.integers(len(places), size=n - n_view)
    around = places[base] + rng.normal(size=(n - n_view, 3)) * 3.0 * _spacing(places)[base, None]
    extra = points_in_view(cameras, n_view, rng) if n_view else np.empty((0, 3))
    # In the mean colour: gray would be far from everything in a dark or bright scene.
    between = np.tile(tints.mean(axis=0), (n_view, 1))
    return np.concatenate([places, around, extra]), np.concatenate([tints, tints[base], between])


def _spacing(places: Float64) -> Float64:
    """Return the mean distance of each point to its three nearest neighbours, within bounds around the median."""
    k = min(_NEIGHBOURS, len(places) - 1)
    if k == 0:
        return np.full(len(places), 0.05)
    distances, _ = cKDTree(places).query(places, k=k + 1)
    spacing = distances[:, 1:].mean(axis=1)
    median = float(np.median(spacing))
    return np.clip(spacing, _SMALLEST_SCALE * median, _LARGEST_SCALE * median)
