"""All bounds of the numerical suite. Whoever raises one writes the reason here, and the table prints it."""

from __future__ import annotations

from dataclasses import dataclass

from ..rasterizer.settings import ALPHA_MAX, T_MIN

__all__ = ["BOUNDS", "DEFAULT", "EPS32", "FLIP", "Bounds", "bounds_of"]

EPS32 = 2.0**-23
"""Distance from 1 to the next float32: the unit of the gradients' bound."""

FLIP = T_MIN * ALPHA_MAX / (1.0 - ALPHA_MAX)
"""Most that one threshold can change a pixel: T <= T_MIN / (1 - ALPHA_MAX) at the cut-off, times ALPHA_MAX.

One Gaussian at the other threshold, ALPHA_MIN, changes it by less than half of that.
"""


@dataclass(frozen=True)
class Bounds:
    """What a case may deviate from float64.

    Attributes
    ----------
    forward : float
        Largest error of a pixel, in units of the largest thing that is blended (or 1), pixels that flipped left out.
    gradient : float
        Error of a Gaussian's gradient in units of ``EPS32`` times its condition number.
    near : float
        A pixel hangs on a threshold when an alpha, a transmittance or the unclamped alpha lies within this part of it.
    near_share : float
        Largest part of the pixels that may hang on a threshold; a case that hides behind thresholds shows nothing.
    reason : str
        Why a bound differs from the default; printed below the table.
    """

    forward: float = 1e-4
    gradient: float = 100.0
    near: float = 1e-5
    near_share: float = 0.02
    reason: str = ""


DEFAULT = Bounds()

_STEP_AT_500_KM = 2.0**-5
_STEP_AT_4500_KM = 2.0**-1

BOUNDS: dict[str, Bounds] = {
    "centre_300_widths_off": Bounds(
        gradient=1000.0,
        reason="A Gaussian 300 picture widths to the side, as large as it is far: when its depth changes, what its "
        "centre and its covariance each do to a pixel is 300 times what both do together, and their float32 sums over "
        "pixels keep 7 digits of the parts. The picture is right to 7 digits; the pull on the mean to 4.",
    ),
    "alpha_at_clamp": Bounds(
        near_share=0.05, reason="The case is about the threshold: the middle of each of its 24 Gaussians lies on it."
    ),
    "transmittance_at_cut_off": Bounds(
        near_share=1.0,
        reason="The case is about the threshold: every pixel lies on it. Two Gaussians of alpha 0.99 leave "
        "0.01 * 0.01, which is 1e-4 in float64 and 9.99998e-5 in float32.",
    ),
    "origin_500_km_raw": Bounds(
        forward=_STEP_AT_500_KM / 2**0.5,
        reason="In metres, sideways: float32 has a step of 1/32 m at 5e5 m, each coordinate is off by half of it. No "
        "kernel can undo that; `cameras.normalise` moves the origin before anything is float32, see the next row.",
    ),
    "origin_4500_km_raw": Bounds(
        forward=_STEP_AT_4500_KM / 2**0.5,
        reason="In metres, sideways: the step of float32 at 4.5e6 m is 0.5 m; as above.",
    ),
    "adam_small_steps": Bounds(
        forward=10_000 * EPS32 / 2,
        reason="Steps of 1.6e-6 are 13 float32 steps of a parameter between 1 and 2, and a steady pull is rounded the "
        "same way each time: 10,000 half steps of float32 at most, 3 % of the way gone.",
    ),
}
"""Cases whose bounds are not the default."""


def bounds_of(case: str) -> Bounds:
    """Return the bounds of the case of this name."""
    return BOUNDS.get(case, DEFAULT)
