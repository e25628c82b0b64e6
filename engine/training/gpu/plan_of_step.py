"""What a graphics card needs for one training step, with the draws of the processor's steps."""

from __future__ import annotations

from ..checkpoint import RunState
from ..densify import MAX_RAISED_OPACITY, MAX_WALK
from ..guards import MAX_ASPECT, MAX_DISTANCE, MAX_LOGIT, MAX_SCALE, MIN_SCALE
from ..schedule import Schedule
from ..step import clusters, samples_of_step
from ..steps import Inputs
from ..views import Level
from .plans import StepPlan
from .settings import StepLimits, StepSettings
from .training_frame import Dropout, PositionNoise


def step_settings(inputs: Inputs) -> StepSettings:
    """Return what is the same in all steps of a run."""
    settings, extent = inputs.settings, inputs.extent
    x, y, z = (float(value) for value in inputs.center)
    limits = StepLimits(
        center=(x, y, z),
        max_distance=MAX_DISTANCE * extent,
        min_scale=MIN_SCALE * extent,
        max_scale=MAX_SCALE * extent,
        max_aspect=MAX_ASPECT,
        max_logit=MAX_LOGIT,
    )
    return StepSettings(
        lambda_exposure=settings.appearance.lambda_exposure if settings.appearance.exposure else 0.0,
        lambda_scale=settings.loss.lambda_scale / extent,
        limits=limits,
        unit_features=settings.features.feature_init == "unit",
        detached_features=settings.features.feature_gradient == "detached",
    )


def plan_of_step(
    inputs: Inputs, schedule: Schedule, state: RunState, step: int, level: Level, *, n_gaussians: int
) -> StepPlan:
    """Return the plan of one step.

    Parameters
    ----------
    state : RunState
        Whose neighbours are those of the present Gaussians where L_reg needs them.
    level : Level
        The photo at the size of this step.

    Returns
    -------
    StepPlan
        Of a photo that is not on the card yet, number -1.
    """
    settings, extent = inputs.settings, inputs.extent
    features, appearance, growth = settings.features, settings.appearance, settings.growth
    rates = schedule.learning_rates(step)
    has_features = "features" in state.parameters.values
    lambda_ray = features.lambda_ray if has_features and clusters(features, step, level) else 0.0
    terms = samples_of_step(state, level, schedule, settings, extent, step=step, n_gaussians=n_gaussians)
    if not any(sample.needs_features for sample in terms):
        del rates["features"]
    dropout = noise = None
    if fraction := schedule.dropout(step):
        dropout = Dropout(fraction, MAX_RAISED_OPACITY, settings.seed, step)
    if growth.noise > 0 and not schedule.growth_ended(step):
        noise = PositionNoise(schedule.means_rate(step) * growth.noise / extent, MAX_WALK, settings.seed, step)
    return StepPlan(
        -1,
        rates,
        schedule.sh_degree(step, state.sh_limit),
        exposure_rate=schedule.exposure_rate(step) if appearance.exposure else None,
        centred=schedule.trained_on(step) if appearance.exposure else (),
        lambda_opacity=schedule.lambda_opacity(step),
        lambda_ray=lambda_ray,
        terms=terms,
        dropout=dropout,
        noise=noise,
    )
