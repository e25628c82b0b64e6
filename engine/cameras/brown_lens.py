"""Lenses of Metashape and RealityCapture, Brown's model with four radial coefficients, as COLMAP's models.

The direction (x, y), with r its length, appears at f (x', y') from the principal point, where::

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) + p1 (r^2 + 2 x^2) + 2 p2 x y
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) + p2 (r^2 + 2 y^2) + 2 p1 x y

with the programs' own p1 and p2, which OpenCV and COLMAP exchange. COLMAP has no k4 for such lenses: its model
FULL_OPENCV, a quotient of polynomials, is fitted over the picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Float64
from ..scene import FISHEYE_LENS, MAX_LENS_PARAMETER, Lens

_TOLERANCE = 2.5e-4
"""Largest error of a lens that COLMAP's models represent approximately, relative to the longest side: one pixel in
4,000. Features of photos are found with a larger error."""
_MAX_RADIUS = 4.0
"""Largest distance from the axis at depth 1; pictures of this model end before."""


@dataclass(frozen=True)
class BrownLens:
    """A lens in pixels, with the coefficients of the module's formula, or the same with r as the angle (`fisheye`).

    `skew` is what a picture's x gains per unit of y', in pixels.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    radial: tuple[float, float, float, float]
    tangential: tuple[float, float]
    skew: float = 0.0
    fisheye: bool = False

    def as_lens(self) -> Lens:
        """Return the lens in a model of COLMAP; raises `ValueError` when none represents it."""
        values = (self.fx, self.fy, self.cx, self.cy, *self.radial, *self.tangential, self.skew)
        if not all(np.isfinite(values)) or max(map(abs, values)) > MAX_LENS_PARAMETER or min(self.fx, self.fy) <= 0.0:
            raise ValueError("its focal length must be above 0 and all its lens values finite")
        longest = max(self.width, self.height)
        # The error of leaving the skew out, at the top or bottom edge.
        if abs(self.skew) * 0.5 * self.height / self.fy > _TOLERANCE * longest:
            raise ValueError("its lens is skewed, which is not supported")
        pinhole = (self.fx, self.fy, self.cx, self.cy)
        k1, k2, k3, k4 = self.radial
        p1, p2 = self.tangential
        if self.fisheye:
            if not (p1 or p2):
                return Lens(FISHEYE_LENS, self.width, self.height, (*pinhole, k1, k2, k3, k4))
            return Lens("THIN_PRISM_FISHEYE", self.width, self.height, (*pinhole, k1, k2, p2, p1, k3, k4, 0.0, 0.0))
        if not any((*self.radial, p1, p2)):
            return Lens("PINHOLE", self.width, self.height, pinhole)
        if not (k3 or k4):
            return Lens("OPENCV", self.width, self.height, (*pinhole, k1, k2, p2, p1))
        numerator, denominator = ((k1, k2, k3), (0.0, 0.0, 0.0)) if not k4 else self._quotient()
        a1, a2, a3 = numerator
        return Lens("FULL_OPENCV", self.width, self.height, (*pinhole, a1, a2, p2, p1, a3, *denominator))

    def _quotient(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the coefficients of the two polynomials of FULL_OPENCV, fitted to the radial distortion."""
        corners = np.array([[x, y] for x in (0.0, self.width) for y in (0.0, self.height)])
        reach = float(np.linalg.norm((corners - (self.cx, self.cy)) / (self.fx, self.fy), axis=1).max())
        radii = np.linspace(0.0, _MAX_RADIUS, 4001)
        factor = self._factor(radii)
        # Up to the corners, or to where the polynomial turns back.
        inside = radii * factor <= reach
        end = int(np.argmin(inside)) if not inside.all() else len(radii)
        growing = np.diff(radii * factor) > 0.0
        end = min(end, int(np.argmin(growing)) + 1) if not growing.all() else end
        radii, factor = radii[1 : end + 1], factor[1 : end + 1]
        square = radii * radii
        powers = np.stack([square, square**2, square**3], axis=1)
        # factor (1 + b s + ...) = 1 + a s + ..., linear in a and b; each row is weighted by its effect in the picture.
        rows = np.concatenate([powers, -factor[:, None] * powers], axis=1) * radii[:, None]
        found = np.linalg.lstsq(rows, (factor - 1.0) * radii, rcond=None)[0]
        numerator, denominator = 1.0 + powers @ found[:3], 1.0 + powers @ found[3:]
        error = np.abs(radii * (numerator / denominator - factor)).max() * max(self.fx, self.fy)
        if not (denominator.min() > 0.0 and error <= _TOLERANCE * max(self.width, self.height)):
            raise ValueError("its lens has a k4 that COLMAP's lens models cannot represent")
        return tuple(map(float, found[:3])), tuple(map(float, found[3:]))

    def _factor(self, radii: Float64) -> Float64:
        square = radii * radii
        return np.asarray(1.0 + np.polyval([*self.radial[::-1], 0.0], square), np.float64)
