"""What makes training steps: the processor or a graphics card, behind one interface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch

from .checkpoint import RunState
from .schedule import Schedule
from .settings import TrainingSettings
from .start import EmptySpace, StartPoints
from .views import Level, ViewPyramid

N_ERROR_VIEWS = 3  # chosen on museum_room
"""Random photos in which the error of each Gaussian is measured before growth."""


@dataclass(frozen=True)
class Inputs:
    """What stays the same during a run.

    Attributes
    ----------
    settings : TrainingSettings
    pyramid : ViewPyramid
        The training photos.
    start_points : StartPoints
    empty_space : EmptySpace or None
        Where no Gaussian stays; None with the published growth.
    center : tensor of shape [3]
        Mean camera position.
    extent : float
        Extent of the scene, world units.
    """

    settings: TrainingSettings
    pyramid: ViewPyramid
    start_points: StartPoints
    empty_space: EmptySpace | None
    center: torch.Tensor
    extent: float


class Steps(Protocol):
    """Makes the steps of one state at a time. The state's numbers may be elsewhere until `store` is called."""

    @property
    def checkpoint_seconds(self) -> float | None:
        """Time between two checkpoints; None where they are written after ``checkpoint_interval`` steps."""

    @property
    def n_gaussians(self) -> int:
        """Present number of Gaussians."""

    def use(self, state: RunState, schedule: Schedule) -> None:
        """Train `state` from now on."""

    def advance(self, n: int) -> float:
        """Make up to `n` steps, at least one, with the growth that is due after them; return the last loss."""

    def picture(self, level: Level, sh_degree: int) -> torch.Tensor:
        """Return the Gaussians over black from the camera of `level`, [h, w, 3] in [0, 1]."""

    def store(self) -> None:
        """Write all numbers into the state."""


def error_levels(inputs: Inputs, schedule: Schedule, step: int, generator: torch.Generator) -> list[tuple[int, int]]:
    """Draw the photos in which errors are measured before growth; return (view, reductions) of each."""
    views = schedule.trained_on(step)
    drawn = torch.randperm(len(views), generator=generator)[:N_ERROR_VIEWS].tolist()
    return [(views[place], schedule.reductions(step)) for place in drawn]
