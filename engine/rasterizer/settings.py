"""Settings of the rasterizer, and the constants that all of its implementations share.

This is the only place that gives these constants a value. The kernels import them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..core.settings import require

Backend = Literal["cpu", "gpu", "reference"]
"""Implementations of `engine.rasterizer.rasterize`."""

DeviceName = Literal["auto", "cpu", "gpu"]
"""What a user may ask to work on; auto: the graphics card if there is one that passes its self-test."""

INVERSE_ALPHA_MIN = 255.0
"""Inverse of `ALPHA_MIN`. It is exact, while 1/255 is rounded, so log(opacity / ALPHA_MIN) is computed from it."""

ALPHA_MIN = 1.0 / INVERSE_ALPHA_MIN
"""Smallest alpha that is blended. A Gaussian with less alpha at a pixel is skipped there, because it would change an
8-bit colour by less than one level, and because every Gaussian then has a finite extent (Kerbl et al. 2023)."""

ALPHA_MAX = 0.99
"""Largest alpha. Larger values are clamped to it and get a gradient of zero. The factor 1 - alpha then stays away from
zero, so that the gradients of the Gaussians behind stay finite (Kerbl et al. 2023)."""

T_MIN = 1e-4
"""Smallest transmittance of a pixel. The Gaussian that would reduce the transmittance below it is not blended, nor is
any Gaussian behind. The transmittance that remains is below T_MIN / (1 - ALPHA_MAX) = 0.01, so the skipped Gaussians
are nearly hidden, and the loop over them ends early (Kerbl et al. 2023)."""

DET_MIN = 1e-6
"""Smallest determinant of a screen covariance, in pixels^4. A Gaussian below it is culled, because its covariance
cannot be inverted reliably."""

COV_MAX = 1e24
"""Largest diagonal entry of a screen covariance, in pixels^2. A Gaussian above it is culled, because the boundary of
such an ellipse cannot be represented in float32."""

QUAT_NORM2_MIN = 1e-16
"""Smallest squared norm of a quaternion. A Gaussian below it is culled, because its rotation is undefined."""

DIRECTION_NORM_MIN = 1e-30
"""Smallest distance, in world units, by which the vector from the camera to a Gaussian is divided to get a viewing
direction. It avoids a division by zero for a Gaussian at the centre of the camera."""

JACOBIAN_MARGIN = 0.15
"""How far outside of the image the projection may be linearised, as a fraction of the image's width and height. Beyond
it, the affine approximation of the projection would stretch Gaussians without bound."""

RADIUS_SIGMAS = 3.0
"""Standard deviations in the radius that is reported for a Gaussian on the screen. It does not affect the image."""

MAX_CHANNELS = 64
"""Largest number of channels of an image. It bounds the scratch memory of a thread: the backward pass copies the
incoming gradient of a tile, which takes 64 KiB with 64 channels and fits the second-level cache."""


@dataclass(frozen=True)
class RasterSettings:
    """How Gaussians are projected and blended.

    Attributes
    ----------
    near : float
        Gaussians whose centre is closer to the camera plane are culled. World units, at least 0.0001. Use at least 0.01
        for a scene of unit size, because closer Gaussians become very large on the screen.
    low_pass : float
        Added to both diagonal entries of the screen covariance, so that no Gaussian falls between pixels. Pixels^2,
        from 0.001 to 10.
    antialiased : bool
        Reduce the opacity of a Gaussian by as much as the low pass widens it: opacity times
        sqrt(det Sigma / det (Sigma + low_pass I)), the 2D filter of Mip-Splatting (Yu et al. 2024). The factor is a
        constant in the backward pass, because its gradient is unbounded for Gaussians far smaller than a pixel.
    threads : int or None
        Number of threads of the ``cpu`` backend; None uses every core that this process may use. The result does not
        depend on it.
    """

    near: float = 0.02
    low_pass: float = 0.3
    antialiased: bool = False
    threads: int | None = None

    def __post_init__(self) -> None:
        require(self, "near", self.near >= 1e-4, "at least 0.0001")
        require(self, "low_pass", 1e-3 <= self.low_pass <= 10.0, "between 0.001 and 10")
        require(self, "threads", self.threads is None or self.threads >= 1, "at least 1 or None")
