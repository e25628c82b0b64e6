"""Training steps on a graphics card. Gaussians, moments and photos stay there; the processor decides where to grow."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import torch

from ...core.errors import EnvironmentProblem
from ...rasterizer.gpu import open_gpu
from ..checkpoint import RunState
from ..densify import grow, grow_by_error, relocate
from ..losses import N_NEIGHBOURS, GpuExposures
from ..population import Population
from ..schedule import GROW, RELOCATE, Schedule
from ..step import neighbours_are_stale, regularises
from ..steps import Inputs, error_levels
from ..views import Level
from .parameters import GpuParameters
from .plan_of_step import plan_of_step, step_settings
from .plans import StepPlan
from .trainer import GpuTrainer

CHECKPOINT_SECONDS = 30.0
"""Time between two checkpoints: what a card that stops working loses at most."""


_ADVICE = (
    "run again, which continues from the last checkpoint; add `--device cpu` to continue on the processor, or choose a "
    "smaller preset if the card's memory is full."
)


@contextlib.contextmanager
def told_how_to_continue(advice: str = _ADVICE) -> Iterator[None]:
    """Give the advice of training in place of that of a single picture.

    Raises
    ------
    EnvironmentProblem
    """
    try:
        yield
    except EnvironmentProblem as problem:
        raise EnvironmentProblem(f"{str(problem).partition(';')[0].rstrip('.')}; {advice}") from problem


class GpuSteps:
    """See `steps.Steps`. The numbers are on the card until `store` is called.

    Raises
    ------
    EnvironmentProblem
        If there is no card, it fails its self-test, its memory is full, or it stops working.
    """

    checkpoint_seconds = CHECKPOINT_SECONDS

    def __init__(self, inputs: Inputs) -> None:
        self._inputs = inputs
        self._gpu = open_gpu()
        self._trainer: GpuTrainer | None = None
        self._photos: dict[tuple[int, int], tuple[Level, int]] = {}

    @property
    def n_gaussians(self) -> int:
        """Present number of Gaussians."""
        return self._card.parameters.n

    @property
    def _card(self) -> GpuTrainer:
        assert self._trainer is not None, "`use` comes first"
        return self._trainer

    @told_how_to_continue()
    def use(self, state: RunState, schedule: Schedule) -> None:
        """Copy `state` to the card and train it from now on."""
        self._state, self._schedule = state, schedule
        parameters, exposure = state.parameters, state.exposure.detach().numpy()
        if self._trainer is None:
            values = {name: value.detach().numpy() for name, value in parameters.values.items()}
            self._trainer = GpuTrainer(
                self._gpu,
                GpuParameters(self._gpu, values, parameters.moments, n_background=parameters.n_background),
                step_settings(self._inputs),
                exposures=GpuExposures(self._gpu, exposure, state.exposure_moments),
                max_gaussians=self._inputs.settings.growth.max_gaussians,
            )
        else:
            self._trainer.upload(parameters.values, parameters.moments, n_background=parameters.n_background)
            self._trainer.exposures.write(exposure, state.exposure_moments)
        self._trainer.guards = Counter(state.guards)

    @told_how_to_continue()
    def advance(self, n: int) -> float:
        """Make up to `n` steps, at least one, with the growth that is due after them; return the last loss."""
        state = self._state
        steps = range(state.step, self._end(n))
        # A thread draws samples and reduces photos while this one queues the steps before.
        with ThreadPoolExecutor(1) as ahead:
            losses = self._card.steps(
                self._on_card(step, *drawn) for step, drawn in zip(steps, ahead.map(self._drawn, steps), strict=True)
            )
        state.guards = Counter(self._card.guards)
        last = steps[-1]
        if self._schedule.grows(last):
            self._update_population(last)
        state.step = last + 1
        reductions = self._schedule.reductions(state.step)
        for key in [key for key in self._photos if key[1] > reductions]:
            self._card.free_photo(self._photos.pop(key)[1])
        return losses[-1]

    def _end(self, n: int) -> int:
        """Return the step before which up to `n` steps end: after growth, or before the next search of neighbours.

        A search that is due in the first step is made.
        """
        state, schedule, settings = self._state, self._schedule, self._inputs.settings
        n_gaussians = self.n_gaussians
        needs_neighbours = "features" in state.parameters.values and settings.features.regularisation == "neighbours"
        for step in range(state.step, state.step + n):
            regularised = needs_neighbours and regularises(settings.features, step, n_gaussians)
            if regularised and neighbours_are_stale(state, step, n_gaussians):
                if step > state.step:
                    return step
                state.neighbours, state.neighbours_step = self._card.nearest_neighbours(N_NEIGHBOURS), step
            if schedule.grows(step):
                return step + 1
        return state.step + n

    def _drawn(self, step: int) -> tuple[Level, StepPlan]:
        """Return the photo of a step at its size, and the plan, in which the number of the photo is missing."""
        schedule = self._schedule
        level = self._inputs.pyramid.level(schedule.view(step), schedule.reductions(step))
        plan = plan_of_step(self._inputs, schedule, self._state, step, level, n_gaussians=self.n_gaussians)
        plan.sort()
        return level, plan

    def _on_card(self, step: int, level: Level, plan: StepPlan) -> StepPlan:
        """Return the plan with the number of its photo."""
        return replace(plan, photo=self._photo(self._schedule.view(step), self._schedule.reductions(step), level))

    def _photo(self, view: int, reductions: int, level: Level) -> int:
        """Return the number on the card of a photo at one size, where it is copied at its first use."""
        key = view, reductions
        known = self._photos.get(key)
        if known is None:
            self._photos[key] = level, self._card.add_photo(level.camera, level.pixels, valid=level.valid, view=view)
        elif known[0] is not level:  # its mask has changed
            self._card.mask_photo(known[1], level.valid)
            self._photos[key] = level, known[1]
        return self._photos[key][1]

    def _update_population(self, step: int) -> None:
        """Relocate and add Gaussians: decided by the processor from their geometry, carried out on the card."""
        state, schedule, inputs = self._state, self._schedule, self._inputs
        growth = inputs.settings.growth
        population = Population(self._card.geometry(), n_background=state.parameters.n_background)
        n = len(population)
        n_new = schedule.gaussians_after_growth(step, n) - n
        moves, additions = (schedule.generator(step, purpose) for purpose in (RELOCATE, GROW))
        errors = None
        if n_new > 0 and growth.growth_strategy == "mixed":
            drawn = error_levels(inputs, schedule, step, additions)
            photos = [self._photo(*one, inputs.pyramid.level(*one)) for one in drawn]
            errors = self._card.gaussian_errors(photos, schedule.sh_degree(step, state.sh_limit))
        relocate(population, empty_space=inputs.empty_space, generator=moves)
        sources = population.values["sources"]
        if errors is not None:
            errors = (errors / sources.bincount(minlength=n))[sources]  # copies at one place share the error
            grow_by_error(population, errors, n_new, inputs.start_points, generator=additions)
        elif n_new > 0:
            grow(population, population.values["opacity_logits"].sigmoid(), n_new, generator=additions)
        if bool(population.fresh.any()):
            self._card.rearrange(population.geometry, population.values["sources"], population.fresh)

    @told_how_to_continue()
    def picture(self, level: Level, sh_degree: int) -> torch.Tensor:
        """Return the Gaussians over black from the camera of `level`, [h, w, 3] in [0, 1]."""
        return torch.from_numpy(self._card.render(level.camera, sh_degree)).clamp_(0.0, 1.0)

    @told_how_to_continue()
    def store(self) -> None:
        """Write all numbers into the state."""
        parameters = self._state.parameters
        parameters.values, parameters.moments = self._card.download()
        self._state.exposure = torch.from_numpy(self._card.exposures.values())
        self._state.exposure_moments = self._card.exposures.moments()
