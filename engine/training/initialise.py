"""Initial Gaussians for training: one at each sparse point, or random ones in the cameras' view where points are few.

As in Kerbl et al. 2023, section 5.1, they are isotropic, with the mean distance to the three nearest neighbours as
standard deviation.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from ..core.arrays import Float64
from ..core.errors import TrainingError
from ..core.events import Emit, Warned, ignore_events
from ..formats import SH_C0
from ..scene import Gaussians, PinholeCamera, unit_quats

_LOG = logging.getLogger(__name__)

FeatureInit = Literal["unit", "paper"]

_MIN_POINTS = 500
"""Below this number the sparse points do not cover the surfaces well enough; random points are added around them."""
_NEIGHBOURS = 3
"""Nearest neighbours whose mean distance is the standard deviation of a Gaussian."""
_MAX_SCALE = 8.0
"""Largest standard deviation in median spacings. A larger Gaussian at an outlier could cover every camera's view."""
_MIN_SCALE = 0.05
"""Smallest standard deviation in median spacings."""


@dataclass(frozen=True)
class InitialValues:
    """Values that all initial Gaussians share.

    Attributes
    ----------
    sh_degree : int
        Degree of the spherical harmonics, 0 to 3; the bands above 0 start at zero.
    feature_dim : int or None
        Length of the segmentation feature, None for no features.
    opacity : float
        Opacity, in (0, 1); values from 0.1 to 0.5 work well.
    feature_init : {"unit", "paper"}
        Distribution of the features, see `initial_features`.
    """

    sh_degree: int
    feature_dim: int | None
    opacity: float = 0.3
    feature_init: FeatureInit = "unit"


def gaussians_from_points(
    points: ArrayLike,
    colors: ArrayLike,
    values: InitialValues,
    *,
    seed: int,
    max_gaussians: int,
    cameras: Sequence[PinholeCamera] = (),
    emit: Emit = ignore_events,
) -> Gaussians:
    """Return Gaussians at sparse `points`, with view-independent colours and random features.

    Parameters
    ----------
    points : array of shape [P, 3]
        Sparse points, world units. Duplicates and rows that are not finite are ignored.
    colors : array of shape [P, 3], uint8
        sRGB.
    values : InitialValues
        Values that all Gaussians share.
    seed : int
        Seed of all random numbers of this function.
    max_gaussians : int
        Maximum number of Gaussians; of more points a random subset is taken.
    cameras : sequence of PinholeCamera
        Cameras in whose view random points are placed when there are few sparse points or none.
    emit : Emit
        Receives a warning when random points were added.

    Returns
    -------
    Gaussians

    Raises
    ------
    TrainingError
        When there are no points and no cameras.
    """
    rng = np.random.default_rng(seed)
    places, tints = _usable_points(points, colors)
    if len(places) == 0:
        places, tints = _scattered_in_view(cameras, max_gaussians, rng, emit)
    elif len(places) > max_gaussians:
        kept = np.sort(rng.choice(len(places), max_gaussians, replace=False))
        places, tints = places[kept], tints[kept]
    elif len(places) < min(_MIN_POINTS, max_gaussians):
        places, tints = _with_random_points(places, tints, min(_MIN_POINTS, max_gaussians), cameras, rng, emit)
    return gaussians_at(places, tints, _spacing(places), values, rng=rng)


def gaussians_at(
    places: Float64,
    colors: Float64,
    scales: Float64,
    values: InitialValues,
    *,
    rng: np.random.Generator,
) -> Gaussians:
    """Return one isotropic Gaussian at each of `places`, with view-independent colour and random features.

    Parameters
    ----------
    places : array of shape [N, 3]
        World units.
    colors : array of shape [N, 3]
        sRGB, 0 to 255.
    scales : array of shape [N]
        Standard deviations, world units.
    values : InitialValues
        Values that all Gaussians share.
    rng : numpy.random.Generator
        Random numbers for quaternions and features.
    """
    n = len(places)
    opacity = values.opacity
    sh = np.zeros((n, (values.sh_degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = (colors / 255.0 - 0.5) / SH_C0
    quats = unit_quats(rng.normal(size=(n, 4)))
    return Gaussians(
        means=places.astype(np.float32),
        log_scales=np.repeat(np.log(scales).astype(np.float32)[:, None], 3, axis=1),
        quats=quats.astype(np.float32),
        opacity_logits=np.full(n, np.log(opacity / (1.0 - opacity)), np.float32),
        sh=sh,
        features=(
            None if values.feature_dim is None else initial_features(n, values.feature_dim, rng, values.feature_init)
        ),
    )


def initial_features(n: int, dim: int, rng: np.random.Generator, init: FeatureInit) -> NDArray[np.float32]:
    """Return random features of shape [n, dim].

    Parameters
    ----------
    n, dim : int
        Number of Gaussians and length of a feature.
    rng : numpy.random.Generator
        Random numbers.
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
    """Return `n` random points inside the cameras' view, shape [n, 3], world units.

    Depths are 0.3 to 2.5 times the distance from the camera to the point nearest to all optical axes, uniform in
    1 / depth, because a camera's depth resolution is uniform in it.
    """
    focus = _focus(cameras)
    chosen = rng.integers(len(cameras), size=n)
    points = np.empty((n, 3))
    for index, camera in enumerate(cameras):
        rows = np.flatnonzero(chosen == index)
        distance = max(float(np.linalg.norm(camera.center - focus)), 1e-3)
        depth = 1.0 / rng.uniform(1.0 / (2.5 * distance), 1.0 / (0.3 * distance), size=len(rows))
        pixels = rng.random((len(rows), 2)) * (camera.width, camera.height)
        rays = np.column_stack([(pixels - camera.K[:2, 2]) / camera.K[[0, 1], [0, 1]], np.ones(len(rows))])
        points[rows] = (rays * depth[:, None] - camera.viewmat[:3, 3]) @ camera.viewmat[:3, :3]
    return points


def _focus(cameras: Sequence[PinholeCamera]) -> Float64:
    """Return the point nearest to all optical axes; for nearly parallel axes, a point one unit in front of them."""
    axes = np.stack([camera.viewmat[2, :3] for camera in cameras])
    centers = np.stack([camera.center for camera in cameras])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    # This weak prior, one unit in front of the cameras, determines the point where the axes do not.
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
        _LOG.warning("%d sparse points are not finite and were ignored", int((~finite).sum()))
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


def _with_random_points(
    places: Float64,
    tints: Float64,
    wanted: int,
    cameras: Sequence[PinholeCamera],
    rng: np.random.Generator,
    emit: Emit,
) -> tuple[Float64, Float64]:
    """Return `wanted` points: the given ones, and random ones around them and (half of them) in the cameras' view."""
    n = wanted - len(places)
    emit(Warned(f"Only {len(places)} sparse points were found; {n} random ones were added around them."))
    n_view = n // 2 if cameras else 0
    base = rng.integers(len(places), size=n - n_view)
    around = places[base] + rng.normal(size=(n - n_view, 3)) * 3.0 * _spacing(places)[base, None]
    extra = points_in_view(cameras, n_view, rng) if n_view else np.empty((0, 3))
    # The mean colour is close to dark and to bright scenes; grey is not.
    mean_color = np.tile(tints.mean(axis=0), (n_view, 1))
    return np.concatenate([places, around, extra]), np.concatenate([tints, tints[base], mean_color])


def _spacing(places: Float64) -> Float64:
    """Return the mean distance of each point to its three nearest neighbours, clamped to bounds around the median."""
    k = min(_NEIGHBOURS, len(places) - 1)
    if k == 0:
        return np.full(len(places), 0.05)
    distances, _ = cKDTree(places).query(places, k=k + 1)
    spacing = distances[:, 1:].mean(axis=1)
    median = float(np.median(spacing))
    return np.clip(spacing, _MIN_SCALE * median, _MAX_SCALE * median)
