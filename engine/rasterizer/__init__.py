"""Differentiable rasterization of 3D Gaussians with any number of channels."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .adam import AdamState, adam_step
    from .api import MAX_CHANNELS, CulledCounts, Raster, rasterize
    from .compilation import warm_up
    from .jit import cache_folder
    from .loss import Target, photometric_loss, ssim
    from .reference import project_centres, project_covariances
    from .still_view import StillView

__all__ = [
    "MAX_CHANNELS",
    "AdamState",
    "CulledCounts",
    "Raster",
    "StillView",
    "Target",
    "adam_step",
    "cache_folder",
    "photometric_loss",
    "project_centres",
    "project_covariances",
    "rasterize",
    "ssim",
    "warm_up",
]

__getattr__ = lazy_exports(__name__, __file__)
