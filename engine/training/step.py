"""One training step: which pictures are rendered, and the loss they give."""

from __future__ import annotations

import torch

from ..rasterizer import Raster, photometric_loss
from .checkpoint import RunState
from .losses import (
    clustering_loss,
    nearest_neighbours,
    neighbour_regulariser,
    paper_regulariser,
    ray_disagreement,
)
from .parameters import blended_features, render
from .schedule import Schedule
from .settings import PAPER_PIXELS, TrainingSettings
from .views import Level

__all__ = ["step_loss"]

_NEIGHBOURS_KEPT = 100
"""Steps after which cached neighbours are found anew; 20 times cheaper than each time, and Gaussians move little."""
_SAMPLE, _ANCHORS = 1, 2
"""Purposes of random draws."""


def step_loss(
    state: RunState, level: Level, view: int, schedule: Schedule, settings: TrainingSettings, extent: float
) -> torch.Tensor:
    """Return the loss of one training step, connected to all parameters it depends on.

    Parameters
    ----------
    state : RunState
        Its cached neighbours may be made anew.
    level : Level
        The photo at this step's resolution.
    view : int
        Number of the photo among those trained on.
    schedule : Schedule
    settings : TrainingSettings
    extent : float
        Of the scene, world units.
    """
    step, values = state.step, state.parameters.values
    clusters = (
        "features" in values
        and level.labelled is not None
        and step % settings.clustering_interval == 0
        and settings.lambda_clustering + settings.lambda_ray > 0
    )
    detached = settings.feature_gradient == "detached" or (
        settings.feature_gradient == "until_grown" and schedule.growth_ended(step, state.cooling_from)
    )
    joint = clusters and not detached
    degree = schedule.sh_degree(step, state.sh_limit)
    raster = render(values, level.camera, settings, sh_degree=degree, features=joint)
    image = raster.image[..., :3]
    if state.uses_exposure:
        image = image * state.exposure[view].exp()
    loss = photometric_loss(image, level.target, lambda_dssim=settings.lambda_dssim)
    if settings.lambda_opacity > 0:
        loss = loss + settings.lambda_opacity * values["opacity_logits"].sigmoid().mean()
    if settings.lambda_scale > 0:
        loss = loss + settings.lambda_scale / extent * values["log_scales"].exp().mean()
    if joint:
        loss = loss + _feature_loss(raster, raster.image[..., 3:], level, schedule, settings, step)
    elif clusters:
        still = {name: value if name == "features" else value.detach() for name, value in values.items()}
        extra = render(still, level.camera, settings, sh_degree=None, features=True)
        loss = loss + _feature_loss(extra, extra.image, level, schedule, settings, step)
    regularises = settings.lambda_pull + settings.lambda_push > 0 and len(state.parameters) > 1
    if "features" in values and regularises and step % settings.regularisation_interval == 0:
        loss = loss + _regulariser(state, schedule, settings, extent)
    return loss


def _feature_loss(
    raster: Raster, features: torch.Tensor, level: Level, schedule: Schedule, settings: TrainingSettings, step: int
) -> torch.Tensor:
    assert level.labelled is not None
    # A sum over pixels: halved pictures and small ones would weigh less than the paper's against the other losses.
    scale = PAPER_PIXELS / (level.camera.width * level.camera.height)
    loss = (
        settings.lambda_clustering
        * scale
        * clustering_loss(
            features,
            level.labelled,
            n_samples=settings.clustering_pixels,
            generator=schedule.generator(step, _SAMPLE),
        )
    )
    if settings.lambda_ray > 0:
        loss = loss + settings.lambda_ray * ray_disagreement(features, raster.transmittance)
    return loss


def _regulariser(state: RunState, schedule: Schedule, settings: TrainingSettings, extent: float) -> torch.Tensor:
    values, generator = state.parameters.values, schedule.generator(state.step, _ANCHORS)
    features = blended_features(values, settings)
    if settings.regularisation == "paper":
        return paper_regulariser(
            features,
            values["means"],
            lambda_pull=settings.lambda_pull,
            lambda_push=settings.lambda_push,
            generator=generator,
        )
    stale = state.neighbours is None or len(state.neighbours) != len(state.parameters)
    if stale or state.step - state.neighbours_step >= _NEIGHBOURS_KEPT:
        state.neighbours, state.neighbours_step = nearest_neighbours(values["means"]), state.step
    assert state.neighbours is not None
    return neighbour_regulariser(
        features,
        values["means"],
        state.neighbours,
        far=extent,
        lambda_pull=settings.lambda_pull,
        lambda_push=settings.lambda_push,
        generator=generator,
    )
