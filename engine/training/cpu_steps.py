"""Training steps on the processor, with PyTorch's automatic differentiation."""

from __future__ import annotations

import torch

from .adam import adam_step
from .checkpoint import RunState
from .densify import gaussian_errors, grow, grow_by_error, position_noise, relocate
from .guards import backward, clamp_parameters, step_finite_rows
from .held_out import render_picture
from .schedule import GROW, NOISE, RELOCATE, Schedule
from .step import step_loss
from .steps import Inputs, error_levels
from .views import Level


class CpuSteps:
    """See `steps.Steps`. The numbers are always in the state."""

    checkpoint_seconds = None

    def __init__(self, inputs: Inputs) -> None:
        self._inputs = inputs

    @property
    def n_gaussians(self) -> int:
        """Present number of Gaussians."""
        return len(self._state.parameters)

    def use(self, state: RunState, schedule: Schedule) -> None:
        """Train `state` from now on."""
        self._state, self._schedule = state, schedule

    def advance(self, n: int) -> float:
        """Make one step, with the growth that is due after it; return its loss."""
        state, inputs, schedule = self._state, self._inputs, self._schedule
        view = schedule.view(state.step)
        level = inputs.pyramid.level(view, schedule.reductions(state.step))
        state.parameters.track()
        state.exposure.requires_grad_(inputs.settings.appearance.exposure).grad = None
        loss = step_loss(state, level, view, schedule, inputs.settings, inputs.extent)
        if backward(loss, state.guards):
            step_finite_rows(state.parameters, self._update, state.guards)
        with torch.no_grad():
            self._update_population()
            clamp_parameters(state.parameters, inputs.center, inputs.extent, state.guards)
        state.step += 1
        return loss.item()

    def picture(self, level: Level, sh_degree: int) -> torch.Tensor:
        """Return the Gaussians over black from the camera of `level`, [h, w, 3] in [0, 1]."""
        backend = self._inputs.settings.backend
        return render_picture(self._state.parameters.values, level, backend=backend, sh_degree=sh_degree)

    def store(self) -> None:
        """Do nothing: the numbers are in the state."""

    def _update(self) -> None:
        state = self._state
        state.parameters.step(self._schedule.learning_rates(state.step))
        if state.exposure.grad is not None:
            exposure, rate = state.exposure.detach(), self._schedule.exposure_rate(state.step)
            adam_step([(exposure, state.exposure.grad, rate)], [state.exposure_moments])
            # The brightness common to all photos is part of the colours of the Gaussians.
            views = self._schedule.trained_on(state.step)
            exposure[views] -= exposure[views].mean(dim=0)

    def _update_population(self) -> None:
        """Relocate and add Gaussians when it is due, and apply the random walk until growth ends."""
        state, growth, schedule = self._state, self._inputs.settings.growth, self._schedule
        if schedule.grows(state.step):
            n = len(state.parameters)
            n_new = schedule.gaussians_after_growth(state.step, n) - n
            moves, additions = (schedule.generator(state.step, purpose) for purpose in (RELOCATE, GROW))
            relocate(state.parameters, empty_space=self._inputs.empty_space, generator=moves)
            if n_new > 0:
                self._grow(n_new, additions)
        if growth.noise > 0 and not schedule.growth_ended(state.step):
            position_noise(
                state.parameters,
                learning_rate=schedule.means_rate(state.step),
                extent=self._inputs.extent,
                strength=growth.noise,
                generator=schedule.generator(state.step, NOISE),
            )

    def _grow(self, n_new: int, generator: torch.Generator) -> None:
        """Add `n_new` Gaussians according to ``growth_strategy``."""
        state, inputs, schedule = self._state, self._inputs, self._schedule
        opacities = state.parameters.values["opacity_logits"].detach().sigmoid()
        if inputs.settings.growth.growth_strategy == "opacity":
            grow(state.parameters, opacities, n_new, generator=generator)
            return
        levels = [inputs.pyramid.level(*one) for one in error_levels(inputs, schedule, state.step, generator)]
        degree = schedule.sh_degree(state.step, state.sh_limit)
        errors = gaussian_errors(state.parameters, levels, backend=inputs.settings.backend, sh_degree=degree)
        grow_by_error(state.parameters, errors, n_new, inputs.start_points, generator=generator)
