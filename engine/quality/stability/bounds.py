"""All bounds of the numerical suite. A bound that is raised needs a reason here; the table prints it."""

from __future__ import annotations

from dataclasses import dataclass

from ...rasterizer.settings import ALPHA_MAX, T_MIN

EPS32 = 2.0**-23
"""Distance from 1 to the next float32 number: the unit of the bound on gradients."""

FLIP = T_MIN * ALPHA_MAX / (1.0 - ALPHA_MAX)
"""Largest change of a pixel when one threshold decides differently: T <= T_MIN / (1 - ALPHA_MAX) at the cut-off, times
ALPHA_MAX. One Gaussian at the other threshold, ALPHA_MIN, changes a pixel by less than half of that."""


@dataclass(frozen=True)
class Bounds:
    """Largest deviations of a case from float64.

    Attributes
    ----------
    forward : float
        Largest error of a pixel in units of the largest blended value (at least 1), without the pixels that flipped.
    gradient : float
        Error of a Gaussian's gradient in units of ``EPS32`` times its condition number.
    near : float
        Relative distance within which an alpha, a transmittance or an unclamped alpha is near a threshold.
    near_share : float
        Largest share of pixels near a threshold: only the other pixels measure the error of the gradients.
    reason : str
        Why a bound differs from the default. It is printed below the table.
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
        reason="The Gaussian is 300 picture widths to the side and as large as it is far away. When its depth changes, "
        "the effects of its centre and of its covariance on a pixel are each 300 times their sum, and the float32 sums "
        "over pixels keep 7 digits of each. The picture is right to 7 digits, the gradient of the mean to 4.",
    ),
    "alpha_at_clamp": Bounds(
        near_share=0.05, reason="The case tests the threshold: the centre of each of its 24 Gaussians lies on it."
    ),
    "transmittance_at_cut_off": Bounds(
        near_share=1.0,
        reason="The case tests the threshold: every pixel lies on it. Two Gaussians of alpha 0.99 leave "
        "0.01 * 0.01, which is 1e-4 in float64 and 9.99998e-5 in float32.",
    ),
    "origin_500_km_raw": Bounds(
        forward=_STEP_AT_500_KM / 2**0.5,
        reason="In metres, sideways: float32 has a step of 1/32 m at 5e5 m, so each coordinate is wrong by up to half "
        "of it. No kernel can correct that; `cameras.normalise` moves the origin before the conversion to float32, "
        "see the next row.",
    ),
    "origin_4500_km_raw": Bounds(
        forward=_STEP_AT_4500_KM / 2**0.5,
        reason="In metres, sideways: as above, with a float32 step of 0.5 m at 4.5e6 m.",
    ),
    "adam_small_steps": Bounds(
        forward=10_000 * EPS32 / 2,
        reason="Steps of 1.6e-6 are 13 float32 steps of a parameter between 1 and 2, and a constant gradient is "
        "rounded in the same direction each time: at most 10,000 half steps of float32, 3 % of the distance covered.",
    ),
}
"""Bounds of the cases that do not have the default bounds."""


def bounds_of(case: str) -> Bounds:
    """Return the bounds of a case by its name."""
    return BOUNDS.get(case, DEFAULT)
