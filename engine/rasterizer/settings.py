"""Settings of the rasterizer, and the three thresholds that every implementation shares."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import require

__all__ = [
    "ALPHA_MAX",
    "ALPHA_MIN",
    "COV_MAX",
    "DET_MIN",
    "JACOBIAN_MARGIN",
    "QUAT_NORM2_MIN",
    "T_MIN",
    "RasterSettings",
]

ALPHA_MIN = 1.0 / 255.0
"""A Gaussian that covers a pixel with less alpha than this is not blended there."""

ALPHA_MAX = 0.99
"""Alpha is clamped to this; above it, its gradient is zero."""

T_MIN = 1e-4
"""The Gaussian that would bring a pixel's transmittance below this is not blended, nor is any behind it."""

DET_MIN = 1e-6
"""A screen covariance with a smaller determinant (pixels^4) is culled."""

COV_MAX = 1e24
"""A screen covariance with a larger diagonal entry (pixels^2) is culled: such an ellipse has no edge in float32."""

QUAT_NORM2_MIN = 1e-16
"""A quaternion with a smaller squared norm has no direction; its Gaussian is culled."""

JACOBIAN_MARGIN = 0.15
"""The projection is linearised at a point at most this part of the picture's size outside of the picture."""


@dataclass(frozen=True)
class RasterSettings:
    """How Gaussians are projected and blended.

    Attributes
    ----------
    near : float
        Gaussians whose centre is nearer to the camera plane are culled; world units, at least 0.01 for a scene of
        unit size (Gaussians nearer than that blow up on the screen).
    low_pass : float
        Added to both diagonal entries of the screen covariance, pixels^2, so that none falls between pixels.
    antialiased : bool
        Fade Gaussians by as much as the low pass widens them: opacity times sqrt(det Sigma / det (Sigma + low_pass I))
        (Yu et al. 2024, Mip-Splatting's 2-D filter). The factor counts as a constant in the backward pass: its own
        gradient grows without bound for Gaussians far smaller than a pixel.
    threads : int or None
        Threads of the ``cpu`` backend; None takes every core this process may use. The result does not depend on it.
    """

    near: float = 0.02
    low_pass: float = 0.3
    antialiased: bool = False
    threads: int | None = None

    def __post_init__(self) -> None:
        require(self, "near", self.near >= 1e-4, "at least 0.0001")
        require(self, "low_pass", 1e-3 <= self.low_pass <= 10.0, "between 0.001 and 10")
        require(self, "threads", self.threads is None or self.threads >= 1, "at least 1 or None")
