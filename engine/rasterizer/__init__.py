"""Differentiable rasterization of 3D Gaussians with any number of channels, with the loss and optimiser of training.

`rasterize` takes Gaussians and a camera and returns a `Raster`. `photometric_loss` compares its image with a photo, and
`adam_step` updates the parameters. `CachedView` renders the same Gaussians many times from one camera, and `GpuScene` on
a graphics card from any camera.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .adam import AdamState, adam_step
    from .api import rasterize, scene_on_card
    from .cached_view import CachedView
    from .compilation import compile_kernels
    from .devices import (
        PROCESSOR,
        Card,
        Device,
        Wanted,
        choose_device,
        choose_objects_device,
        choose_training_device,
        device_words,
        fallback,
        look_for_card,
        run_on,
        training_stopped,
    )
    from .gpu import (
        ClusteringSample,
        Dropout,
        GpuExposures,
        GpuParameters,
        GpuScene,
        GpuTrainer,
        NeighbourSample,
        PaperSample,
        PositionNoise,
        StepPlan,
        open_gpu,
    )
    from .jit import cache_folder
    from .loss import Target, photometric_loss, ssim
    from .raster import CulledCounts, Raster
    from .reference import project_centres, project_covariances
    from .settings import MAX_CHANNELS

__all__ = [
    "MAX_CHANNELS",
    "PROCESSOR",
    "AdamState",
    "CachedView",
    "Card",
    "ClusteringSample",
    "CulledCounts",
    "Device",
    "Dropout",
    "GpuExposures",
    "GpuParameters",
    "GpuScene",
    "GpuTrainer",
    "NeighbourSample",
    "PaperSample",
    "PositionNoise",
    "Raster",
    "StepPlan",
    "Target",
    "Wanted",
    "adam_step",
    "cache_folder",
    "choose_device",
    "choose_objects_device",
    "choose_training_device",
    "compile_kernels",
    "device_words",
    "fallback",
    "look_for_card",
    "open_gpu",
    "photometric_loss",
    "project_centres",
    "project_covariances",
    "rasterize",
    "run_on",
    "scene_on_card",
    "ssim",
    "training_stopped",
]

__getattr__ = lazy_exports(__name__, __file__)
