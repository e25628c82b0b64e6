"""Settings of training steps on a graphics card. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass

from ...rasterizer.settings import RasterSettings
from ..settings import LAMBDA_DSSIM


@dataclass(frozen=True)
class StepLimits:
    """Ranges that Gaussians are kept in after each training step on a graphics card.

    Attributes
    ----------
    center : tuple of 3 float
        Centre of the cube that the means stay in, world units.
    max_distance : float
        Half of its side, world units.
    min_scale, max_scale : float
        World units.
    max_aspect : float
        Largest ratio of the longest to the shortest scale.
    max_logit : float
        Largest absolute opacity logit.
    """

    center: tuple[float, float, float]
    max_distance: float
    min_scale: float
    max_scale: float
    max_aspect: float
    max_logit: float


@dataclass(frozen=True)
class StepSettings:
    """What is the same in all training steps on a graphics card.

    Attributes
    ----------
    lambda_dssim : float
        Weight of 1 - SSIM in the loss, 0 to 1; that of the mean |x - y| is 1 - lambda_dssim.
    lambda_exposure : float
        Weight of the sum of the squares of a photo's exposure.
    lambda_scale : float
        Weight of the mean scale in world units.
    limits : StepLimits, optional
        Applied after each step. Without them, quats are not normalised either.
    unit_features : bool
        Whether features are divided by their length before they are blended.
    detached_features : bool
        Whether the gradient of blended features changes no Gaussian.
    raster : RasterSettings
    """

    lambda_dssim: float = LAMBDA_DSSIM
    lambda_exposure: float = 0.0
    lambda_scale: float = 0.0
    limits: StepLimits | None = None
    unit_features: bool = False
    detached_features: bool = False
    raster: RasterSettings = RasterSettings()
