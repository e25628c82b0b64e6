"""The initial Gaussians of a training run, at the sparse points, and what lies near them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..core.events import Emit
from ..scene import FEATURE_DIM, CameraSet, Gaussians
from . import InitialValues, gaussians_from_points
from .settings import TrainingSettings
from .views import TrainingView

N_NEIGHBOURS = 3  # Kerbl et al. 2023
"""Nearest other points that tell the spacing at a point."""

MAX_SPACINGS = 3.0  # chosen on skull66, sakharov_statue32, room_6, store_room, banana16
"""Distance from a point, in its spacings, up to which a place counts as near it."""


_NTH_NEAREST = 5
"""The distance of the so-many-nearest point tells how near to a camera things are: nearer ones may be mistakes."""

_EMPTY_PART = 0.6  # chosen on skull66, room_3, room_6
"""Part of that distance within which nothing stands."""


def start_gaussians(
    camera_set: CameraSet, views: Sequence[TrainingView], settings: TrainingSettings, *, emit: Emit
) -> Gaussians:
    """Return Gaussians at the sparse points, or at random places in view of the training photos without any.

    Parameters
    ----------
    camera_set : CameraSet
        Cameras and sparse points, of which there may be none.
    views : sequence of TrainingView
        Held-out ones are not used.
    settings : TrainingSettings
        `max_gaussians` less the background is the largest number that is returned.
    emit : Emit
        Receives a warning when random points had to be added.

    Raises
    ------
    TrainingError
        When there are neither points nor photos to train on.
    """
    return gaussians_from_points(
        camera_set.points,
        camera_set.point_colors,
        initial_values(settings, opacity=settings.growth.start_opacity),
        seed=settings.seed,
        max_gaussians=settings.growth.max_gaussians - settings.growth.n_background,
        cameras=[view.pinhole for view in views if not view.held_out],
        emit=emit,
    )


def initial_values(settings: TrainingSettings, *, opacity: float) -> InitialValues:
    """Return the values that all initial Gaussians of one opacity share."""
    feature_dim = FEATURE_DIM if settings.features.train_features else None
    return InitialValues(settings.appearance.sh_degree, feature_dim, opacity, settings.features.feature_init)


class StartPoints:
    """The places where training starts: structure from motion saw surfaces there in several photos.

    Parameters
    ----------
    points : array of shape [P, 3]
        World units.
    """

    def __init__(self, points: NDArray[np.floating]) -> None:
        self._tree = cKDTree(points)
        k = min(N_NEIGHBOURS + 1, len(points))
        # The first neighbour of a point is the point itself. A single point has no spacing: everything is near it.
        distances = self._tree.query(points, k=list(range(2, k + 1)))[0] if k > 1 else np.full((len(points), 1), np.inf)
        self._reach = MAX_SPACINGS * distances.mean(axis=1)

    def near(self, means: torch.Tensor) -> torch.Tensor:
        """Return which of `means`, [N, 3], lie within `MAX_SPACINGS` of the nearest point."""
        distances, nearest = self._tree.query(means.numpy(), workers=-1)
        return torch.from_numpy(distances <= self._reach[nearest])


class EmptySpace:
    """The surroundings of the training cameras, as wide as the nearest points tell, where nothing stands.

    Without this, what stands between two cameras is seen from the other side of the scene only, before the background,
    and explains it there; see docs/training.md.

    Parameters
    ----------
    points : array of shape [P, 3]
        Where training starts, world units.
    eyes : array of shape [C, 3]
        Positions of the cameras.
    """

    def __init__(self, points: NDArray[np.floating], eyes: NDArray[np.floating]) -> None:
        distances = cKDTree(points).query(eyes, k=[min(_NTH_NEAREST, len(points))])[0][:, 0]
        self._eyes, self._radii = cKDTree(eyes), _EMPTY_PART * distances

    def holds(self, means: torch.Tensor) -> torch.Tensor:
        """Return which of `means`, [N, 3], lie within the surroundings of the nearest camera."""
        distances, nearest = self._eyes.query(means.numpy(), workers=-1)
        return torch.from_numpy(distances < self._radii[nearest])
