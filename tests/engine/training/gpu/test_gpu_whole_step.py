"""Many steps with all terms on the card, against the processor's trainer's own step."""

from __future__ import annotations

import numpy as np
import torch

from engine.rasterizer.gpu import Gpu
from engine.training import AdamState, Target, adam_step, guards
from engine.training.checkpoint import RunState
from engine.training.gpu import GpuParameters, GpuTrainer, StepLimits, StepPlan, StepSettings
from engine.training.losses import (
    N_ANCHORS,
    N_FAR,
    N_FAR_CANDIDATES,
    ClusteringSample,
    GpuExposures,
    NeighbourSample,
    labelled_pixels,
    nearest_neighbours,
)
from engine.training.schedule import ANCHORS, SAMPLE, Schedule
from engine.training.settings import PAPER_PIXELS, TrainingSettings
from engine.training.step import step_loss
from engine.training.views import Level

from ...rasterizer.scenes import camera
from ...rasterizer.test_cpu_against_reference import relative_errors
from .test_gpu_training import arrays, photo, start

VIEWS = [camera(64, 48), camera(64, 48, off_center=False)]
EXTENT = 2.0
CENTER = (0.1, 0.0, 2.0)
SETTINGS = TrainingSettings().changed(
    steps=1000, sh_interval=3, lambda_opacity=0.05, lambda_opacity_end=0.01, grow_from=0.005, lambda_scale=0.05,
    exposure=True, lambda_ray=0.05,
    lambda_clustering=1e-4, clustering_interval=2, clustering_pixels=500, regularisation_interval=3,
)  # fmt: skip


def levels() -> list[Level]:
    found = []
    for number, view in enumerate(VIEWS):
        x, _ = np.meshgrid(np.arange(view.width), np.arange(view.height))
        valid = np.ones(x.shape, bool)
        valid[5:15, 5:20] = False
        pixels = (photo(view, number) * 0.7).astype(np.uint8)
        labels = np.where(valid, 1 + x // 13, 0).astype(np.int32)
        target = Target(pixels, valid=valid)
        found.append(Level(view, pixels, target, labelled_pixels(labels, min_pixels=8), valid))
    return found


def plan(step: int, schedule: Schedule, levels: list[Level], neighbours: torch.Tensor) -> StepPlan:
    """Return what the card needs for the step of `Schedule`, with the draws of the processor's trainer."""
    view, features = schedule.view(step), SETTINGS.features
    rates, clustering, regulariser = schedule.learning_rates(step), None, None
    if step % features.clustering_interval == 0:
        labelled, generator = levels[view].labelled, schedule.generator(step, SAMPLE)
        assert labelled is not None and len(labelled) > features.clustering_pixels
        drawn = torch.randint(len(labelled), (features.clustering_pixels,), generator=generator).numpy()
        scale = PAPER_PIXELS / (VIEWS[view].width * VIEWS[view].height)
        weight = features.lambda_clustering * scale * len(labelled) / len(drawn)
        clustering = ClusteringSample(*labelled.at(drawn), labelled.counts.numpy(), weight)
    if step % features.regularisation_interval == 0:
        n, generator = len(neighbours), schedule.generator(step, ANCHORS)
        anchors = torch.randint(n, (min(N_ANCHORS, n),), generator=generator)
        tries = torch.randint(n, (len(anchors), N_FAR_CANDIDATES), generator=generator)
        regulariser = NeighbourSample(
            anchors.numpy(), neighbours[anchors].numpy(), tries.numpy(), N_FAR, EXTENT,
        )  # fmt: skip
    if clustering is None and regulariser is None:
        del rates["features"]
    return StepPlan(
        view, rates, schedule.sh_degree(step), exposure_rate=SETTINGS.optimiser.lr_exposure,
        centred=schedule.trained_on(step), lambda_opacity=schedule.lambda_opacity(step),
        lambda_ray=0.0 if clustering is None else features.lambda_ray,
        terms=[sample for sample in (clustering, regulariser) if sample is not None],
    )  # fmt: skip


def test_steps_with_all_terms_are_those_of_the_processors_trainer(opened_gpu: Gpu) -> None:
    photos, n_steps = levels(), 13
    schedule = Schedule(SETTINGS, len(VIEWS), EXTENT, labelled=[0, 1])
    exposure = torch.zeros(2, 3)
    state = RunState(start(n_features=6), exposure, AdamState.zeros_like(exposure))
    # Late in a run, fresh Gaussians meet the limit of a step.
    for moments in (*state.parameters.moments.values(), state.exposure_moments):
        moments.step = 2000
    neighbours = nearest_neighbours(state.parameters.values["means"])
    limits = StepLimits(
        CENTER, guards.MAX_DISTANCE * EXTENT, guards.MIN_SCALE * EXTENT, guards.MAX_SCALE * EXTENT,
        guards.MAX_ASPECT, guards.MAX_LOGIT,
    )  # fmt: skip
    settings = StepSettings(
        lambda_scale=SETTINGS.loss.lambda_scale / EXTENT,
        lambda_exposure=SETTINGS.appearance.lambda_exposure, unit_features=True, limits=limits,
    )  # fmt: skip
    before = arrays(state.parameters)
    exposures = GpuExposures(opened_gpu, np.zeros((2, 3), np.float32), state.exposure_moments)
    parameters = GpuParameters(opened_gpu, before, state.parameters.moments)
    trainer = GpuTrainer(opened_gpu, parameters, settings, exposures=exposures)
    for view, level in enumerate(photos):
        trainer.add_photo(level.camera, level.pixels, valid=level.valid, view=view)
    losses = trainer.steps([plan(step, schedule, photos, neighbours) for step in range(n_steps)])
    expected = []

    def update() -> None:
        state.parameters.step(schedule.learning_rates(state.step))
        values, rate = state.exposure.detach(), SETTINGS.optimiser.lr_exposure
        assert state.exposure.grad is not None
        adam_step([(values, state.exposure.grad, rate)], [state.exposure_moments])
        values -= values.mean(dim=0)

    for step in range(n_steps):
        view = schedule.view(step)
        state.parameters.track()
        state.exposure.requires_grad_(True).grad = None
        loss = step_loss(state, photos[view], view, schedule, SETTINGS, EXTENT)
        assert guards.backward(loss, state.guards)
        guards.step_finite_rows(state.parameters, update, state.guards)
        with torch.no_grad():
            guards.clamp_parameters(state.parameters, torch.tensor(CENTER), EXTENT, state.guards)
        state.step += 1
        expected.append(loss.item())
    # Differences grow with the steps, because Adam moves a value by its learning rate whatever its gradient's size.
    np.testing.assert_allclose(losses, expected, rtol=1e-4)
    assert trainer.parameters.steps == {name: one.step for name, one in state.parameters.moments.items()}
    assert {name: n for name, n in trainer.guards.items() if n} == {k: n for k, n in state.guards.items() if n}
    assert np.abs(trainer.exposures.values() - state.exposure.detach().numpy()).max() <= 2e-5
    rates, found = schedule.learning_rates(0), trainer.parameters.values()
    for name, value in arrays(state.parameters).items():
        difference = np.abs(found[name] - value) / rates[name]
        assert np.median(difference) <= 2e-3 and np.quantile(difference, 0.95) <= 2e-2, name
    for name, own in trainer.parameters.moments().items():
        errors = relative_errors(own.mean, state.parameters.moments[name].mean)
        assert float(errors.median()) <= 1e-4 and float(errors.quantile(0.95)) <= 1e-2, name
