"""Which Gaussians a view draws, and in which order. Does not import bpy.

Arrays are in the frame of the camera: x to the right, y up, z towards the viewer, as in Blender.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...engine.core.arrays import Float32
from ...engine.rasterizer.settings import ALPHA_MIN, RasterSettings

_KNUD_THOMSEN = 1.6075
"""Exponent of Thomsen's formula for the surface of an ellipsoid; its error is at most 1.1 %."""
_MARGIN = 1.05
"""Multiple of the half width of the view within which a Gaussian is drawn: the low-pass filter makes it larger."""
_NEAR = RasterSettings().near


@dataclass(frozen=True)
class View:
    """How a viewport projects: to ``(scale_x x + shift_x z) / -z``, or ``scale_x x + shift_x`` without perspective.

    Attributes
    ----------
    scale, shift : (float, float)
        Entries of Blender's window matrix, for x and y.
    is_perspective : bool
    """

    scale: tuple[float, float]
    shift: tuple[float, float]
    is_perspective: bool


def mean_areas(scales: Float32) -> Float32:
    """Return the mean area of the shadow of each Gaussian over all directions, shape [N].

    By Cauchy's theorem, it is a quarter of the surface of the ellipsoid of one standard deviation. The surface is
    Thomsen's approximation ``4 pi ((ab)^p + (ac)^p + (bc)^p)^(1/p) / 3^(1/p)`` with ``p = 1.6075``.

    Parameters
    ----------
    scales : array of shape [N, 3]
        Standard deviations along the own axes.
    """
    a, b, c = scales.T.astype(np.float64)
    p = _KNUD_THOMSEN
    total = ((a * b) ** p + (a * c) ** p + (b * c) ** p) / 3
    return (np.pi * total ** (1 / p)).astype(np.float32)


def draw_order(
    centers: Float32, radii: Float32, weights: Float32, view: View, *, share: float = 1.0, members: NDArray[np.bool_]
) -> NDArray[np.intp]:
    """Return the rows of the Gaussians to draw, the farthest first.

    Parameters
    ----------
    centers : array of shape [N, 3]
        Centres in the frame of the camera.
    radii : array of shape [N]
        Largest distance from the centre at which a Gaussian is visible.
    weights : array of shape [N]
        Opacity times the square root of `mean_areas`.
    share : float
        Share of the Gaussians in the view that is drawn, those with the greatest importance: ``weight / depth``, which
        is opacity times the square root of the mean projected area. With the area itself, details are lost first; see
        docs/design_notes/blender.md.
    members : array of shape [N]
        Gaussians that may be drawn, for example those whose membership reaches the threshold.
    """
    x, y, z = centers.T
    if view.is_perspective:
        reach = np.maximum(-z, 0)
        # A shift moves the picture by shift * z / -z.
        inside = (z < -_NEAR) & _within(x * view.scale[0] - view.shift[0] * reach, reach, radii * abs(view.scale[0]))
        inside &= _within(y * view.scale[1] - view.shift[1] * reach, reach, radii * abs(view.scale[1]))
    else:
        one = np.ones(1, np.float32)
        inside = _within(x * view.scale[0] + view.shift[0], one, radii * abs(view.scale[0]))
        inside &= _within(y * view.scale[1] + view.shift[1], one, radii * abs(view.scale[1]))
    rows = np.flatnonzero(inside & members)
    count = int(np.ceil(len(rows) * share))
    if count < len(rows):
        importance = weights[rows]
        if view.is_perspective:
            importance = importance / -z[rows]
        rows = rows[np.argpartition(importance, len(rows) - count)[len(rows) - count :]]
    return rows[np.argsort(z[rows])]


def _within(position: Float32, reach: Float32, radius: Float32) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = np.abs(position) <= _MARGIN * reach + radius
    return found


def visible_radii(scales: Float32, opacities: Float32) -> Float32:
    """Return the largest distance from its centre at which each Gaussian is visible, shape [N].

    Beyond it, the density is below 1/255 (`ALPHA_MIN`).
    """
    cutoff = np.sqrt(2 * np.log(np.maximum(opacities / ALPHA_MIN, 1)))
    return (cutoff * scales.max(axis=1)).astype(np.float32)
