"""The initial Gaussians of a training run, at the sparse points."""

from __future__ import annotations

from collections.abc import Sequence

from ..events import Emit
from ..gaussians import InitialValues, gaussians_from_points
from ..scene import FEATURE_DIM, CameraSet, Gaussians
from .settings import TrainingSettings
from .views import TrainingView

__all__ = ["initial_values", "start_gaussians"]


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
