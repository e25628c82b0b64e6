"""The loss of one training step: the pictures that are rendered and the terms that are added, also on a card."""

from __future__ import annotations

import torch

from .checkpoint import RunState
from .densify import drop
from .losses import (
    N_FAR,
    ClusteringSample,
    LabelledPixels,
    NeighbourSample,
    PaperSample,
    Sample,
    clustering_loss,
    drawn_anchors,
    drawn_of_paper,
    drawn_pixels,
    nearest_neighbours,
    neighbour_regulariser,
    paper_regulariser,
    photometric_loss,
    ray_disagreement,
)
from .parameters import blended_features, render
from .schedule import ANCHORS, DROP, SAMPLE, Schedule
from .settings import PAPER_PIXELS, FeatureSettings, TrainingSettings
from .views import Level

NEIGHBOUR_UPDATE_INTERVAL = 100  # chosen on museum_room
"""Steps after which the cached neighbours are found again. Gaussians move little in between."""


def step_loss(
    state: RunState, level: Level, view: int, schedule: Schedule, settings: TrainingSettings, extent: float
) -> torch.Tensor:
    """Return the loss of one training step with its gradient graph.

    Parameters
    ----------
    state : RunState
        Its cached neighbours may be updated.
    level : Level
        The photo at the size of this step.
    view : int
        Number of the photo among the training photos.
    extent : float
        Extent of the scene, world units.
    """
    step, values, features = state.step, state.parameters.values, settings.features
    evaluates_clustering = "features" in values and clusters(features, step, level)
    detached = features.feature_gradient == "detached"
    degree = schedule.sh_degree(step, state.sh_limit)
    channels = blended_features(values, features) if evaluates_clustering else None
    opacities = values["opacity_logits"].sigmoid()
    rendered = opacities
    if dropout := schedule.dropout(step):
        n_background = state.parameters.n_background
        rendered = drop(opacities, dropout, n_background=n_background, generator=schedule.generator(step, DROP))
    raster = render(
        values, level.camera, backend=settings.backend, sh_degree=degree, channels=channels,
        detached_channels=detached, opacities=rendered,
    )  # fmt: skip
    image = raster.image[..., :3]
    if settings.appearance.exposure:
        image = image * state.exposure[view].exp()
    loss = photometric_loss(image, level.target)
    if settings.appearance.exposure:
        loss = loss + settings.appearance.lambda_exposure * state.exposure[view].square().sum()
    if lambda_opacity := schedule.lambda_opacity(step):
        loss = loss + lambda_opacity * opacities.mean()
    if settings.loss.lambda_scale > 0:
        loss = loss + settings.loss.lambda_scale / extent * values["log_scales"].exp().mean()
    if evaluates_clustering:
        transmittance = raster.transmittance.detach() if detached else raster.transmittance
        sample = schedule.generator(step, SAMPLE)
        loss = loss + _feature_loss(raster.image[..., 3:], transmittance, level, sample, features)
    if "features" in values and regularises(features, step, len(state.parameters)):
        loss = loss + _regulariser(state, schedule.generator(step, ANCHORS), features, extent)
    return loss


def samples_of_step(
    state: RunState,
    level: Level,
    schedule: Schedule,
    settings: TrainingSettings,
    extent: float,
    *,
    step: int,
    n_gaussians: int,
) -> list[Sample]:
    """Return what the losses with kernels of their own are evaluated on in a step on a card, as `step_loss` adds them.

    Parameters
    ----------
    state : RunState
        Whose neighbours are those of the present Gaussians where L_reg needs them.
    level : Level
        The photo at the size of the step.
    extent : float
        Extent of the scene, world units.
    step, n_gaussians : int
        Number of the step, and of the Gaussians on the card.
    """
    samples: list[Sample] = []
    features = settings.features
    has_features = "features" in state.parameters.values
    if has_features and clusters(features, step, level):
        assert level.labelled is not None
        weight = features.lambda_clustering * clustering_scale(level)
        samples.append(_clustering_sample(level.labelled, weight, features, schedule.generator(step, SAMPLE)))
    if has_features and regularises(features, step, n_gaussians):
        generator = schedule.generator(step, ANCHORS)
        samples.append(_regulariser_sample(state, n_gaussians, extent, features, generator))
    return samples


def clusters(features: FeatureSettings, step: int, level: Level) -> bool:
    """Return whether L_CC, and the disagreement along rays, are evaluated in the step."""
    weight = features.lambda_clustering + features.lambda_ray
    return level.labelled is not None and step % features.clustering_interval == 0 and weight > 0


def regularises(features: FeatureSettings, step: int, n: int) -> bool:
    """Return whether L_reg of `n` Gaussians is evaluated in the step."""
    return n > 1 and step % features.regularisation_interval == 0


def neighbours_are_stale(state: RunState, step: int, n: int) -> bool:
    """Return whether the neighbours of `n` Gaussians have to be found again for the step."""
    missing = state.neighbours is None or len(state.neighbours) != n
    return missing or step - state.neighbours_step >= NEIGHBOUR_UPDATE_INTERVAL


def clustering_scale(level: Level) -> float:
    """Return the factor of L_CC, a sum over pixels, by which it weighs as much as on pictures of the paper's size."""
    return PAPER_PIXELS / (level.camera.width * level.camera.height)


def _feature_loss(
    features: torch.Tensor,
    transmittance: torch.Tensor,
    level: Level,
    generator: torch.Generator,
    settings: FeatureSettings,
) -> torch.Tensor:
    assert level.labelled is not None
    loss = (
        settings.lambda_clustering
        * clustering_scale(level)
        * clustering_loss(
            features,
            level.labelled,
            n_samples=settings.clustering_pixels,
            generator=generator,
        )
    )
    if settings.lambda_ray > 0:
        loss = loss + settings.lambda_ray * ray_disagreement(features, transmittance)
    return loss


def _regulariser(state: RunState, generator: torch.Generator, settings: FeatureSettings, extent: float) -> torch.Tensor:
    values = state.parameters.values
    features = blended_features(values, settings)
    if settings.regularisation == "paper":
        return paper_regulariser(features, values["means"], generator=generator)
    if neighbours_are_stale(state, state.step, len(state.parameters)):
        state.neighbours, state.neighbours_step = nearest_neighbours(values["means"]), state.step
    assert state.neighbours is not None
    return neighbour_regulariser(features, values["means"], state.neighbours, far=extent, generator=generator)


def _clustering_sample(
    labelled: LabelledPixels, weight: float, features: FeatureSettings, generator: torch.Generator
) -> ClusteringSample:
    index, cluster, times = drawn_pixels(labelled, features.clustering_pixels, generator)
    return ClusteringSample(index, cluster, labelled.counts.numpy(), weight * times)


def _regulariser_sample(
    state: RunState, n: int, extent: float, features: FeatureSettings, generator: torch.Generator
) -> NeighbourSample | PaperSample:
    if features.regularisation == "paper":
        subset, anchors = drawn_of_paper(n, generator)
        return PaperSample(subset.numpy(), anchors.numpy())
    assert state.neighbours is not None
    anchors, tries = drawn_anchors(n, generator)
    near = state.neighbours[anchors]
    return NeighbourSample(anchors.numpy(), near.numpy(), tries.numpy(), N_FAR, extent)
