"""The Gaussians a training run starts from."""

from __future__ import annotations

from collections.abc import Sequence

from ..cameras.camera import CameraSet
from ..events import Emit
from ..gaussians.gaussians import FEATURE_DIM, Gaussians
from ..gaussians.initialise import gaussians_from_points
from .settings import TrainingSettings
from .views import TrainingView

__all__ = ["start_gaussians"]


def start_gaussians(
    camera_set: CameraSet, views: Sequence[TrainingView], settings: TrainingSettings, *, emit: Emit
) -> Gaussians:
    """Return Gaussians at the sparse points and in the background of the training photos, as `settings` ask for.

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
    return gaussians_from_points(
        camera_set.points,
        camera_set.point_colors,
        sh_degree=settings.sh_degree,
        feature_dim=FEATURE_DIM if settings.features else None,
        seed=settings.seed,
        max_gaussians=settings.max_gaussians,
        cameras=[view.pinhole for view in views if not view.held_out],
        background=int(settings.background * settings.max_gaussians),
        opacity=settings.start_opacity,
        feature_init=settings.feature_init,
        emit=emit,
    )
