"""Training steps on a graphics card, in WGSL: parameters, optimiser, random walk, limits, and the plan of each step.

`GpuSteps` makes the steps of a run. `GpuTrainer` makes steps whose data stay on the card, each by a `StepPlan`. The
losses are in `engine.training.losses`, pictures and their gradients in `engine.rasterizer.gpu`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .detail import GpuDetailSteps
    from .parameters import GpuParameters
    from .plans import StepPlan
    from .settings import StepLimits, StepSettings
    from .steps import GpuSteps
    from .trainer import GpuTrainer
    from .training_frame import Dropout, PositionNoise

__getattr__ = lazy_exports(__name__, __file__)
