"""A scalar, unblocked rasterizer in Numba with the algorithm of the original CUDA code, for `benchmarks.raster`.

One loop runs over single pixels and single Gaussians: no vectors, no blocks of pixels, no test of which blocks a
Gaussian touches. A Gaussian is listed in all tiles of the square of three standard deviations around it, and the
backward pass runs from back to front and rebuilds the transmittance by division (Kerbl et al. 2023). That is natural on
a GPU and slow on a CPU. Its time shows what vectors and blocks gain; it is no measure of a fast rasterizer, so no goal
refers to it. The rasterizer only blends: it takes ellipses on the screen and returns their gradients, so its time does
not include projection and spherical harmonics.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from engine.core.arrays import Float32
from engine.rasterizer.settings import ALPHA_MAX, ALPHA_MIN, T_MIN

TILE = 16
"""Side of a tile in pixels."""


_ALPHA_MIN, _ALPHA_MAX, _T_MIN = np.float32(ALPHA_MIN), np.float32(ALPHA_MAX), np.float32(T_MIN)


@dataclass(frozen=True)
class Ellipses:
    """Gaussians on the screen.

    Attributes
    ----------
    pixels : float32 array of shape [N, 2]
        Centres in pixels.
    conics : float32 array of shape [N, 3]
        xx, xy and yy of the inverse covariances, pixels^-2.
    opacities, depths : float32 arrays of shape [N]
    radii : float32 array of shape [N]
        Three standard deviations along the longer axis, pixels.
    """

    pixels: Float32
    conics: Float32
    opacities: Float32
    depths: Float32
    radii: Float32


class ScalarRaster:
    """Forward and backward pass of `ellipses` with `colors` [N, K] in an image of `width` x `height` pixels."""

    def __init__(self, ellipses: Ellipses, colors: Float32, width: int, height: int) -> None:
        self.ellipses, self.colors, self.width, self.height = ellipses, colors, width, height

    def forward_backward(self, upstream: Float32) -> tuple[Float32, Float32]:
        """Return the image [H, W, K] and the gradients [N, 6 + K] of centre, conic, opacity and colour."""
        e = self.ellipses
        starts, order = _bin(e.pixels, e.radii, e.depths, self.width, self.height)
        image = np.zeros((self.height, self.width, self.colors.shape[1]), np.float32)
        last = np.zeros((self.height, self.width), np.int32)
        transmittance = np.ones((self.height, self.width), np.float32)
        _forward(starts, order, e.pixels, e.conics, e.opacities, self.colors, image, last, transmittance)
        pairs = np.zeros((len(order), 6 + self.colors.shape[1]), np.float32)
        _backward(starts, order, e.pixels, e.conics, e.opacities, self.colors, upstream, last, transmittance, pairs)
        gradients = np.zeros((len(self.colors), pairs.shape[1]), np.float32)
        _sum_pairs(order, pairs, gradients)
        return image, gradients


@njit(cache=True)
def _bin(
    pixels: Float32, radii: Float32, depths: Float32, width: int, height: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the start of each tile's list [n_tiles + 1], and all lists of Gaussians in turn, nearest first."""
    n_x, n_y = (width + TILE - 1) // TILE, (height + TILE - 1) // TILE
    order = np.argsort(depths)
    counts = np.zeros(n_x * n_y + 1, np.int64)
    boxes = np.empty((len(pixels), 4), np.int64)
    for g in range(len(pixels)):
        boxes[g, 0] = min(max(0, int((pixels[g, 0] - radii[g]) // TILE)), n_x)
        boxes[g, 1] = min(max(0, int((pixels[g, 0] + radii[g] + TILE - 1) // TILE)), n_x)
        boxes[g, 2] = min(max(0, int((pixels[g, 1] - radii[g]) // TILE)), n_y)
        boxes[g, 3] = min(max(0, int((pixels[g, 1] + radii[g] + TILE - 1) // TILE)), n_y)
        for y in range(boxes[g, 2], boxes[g, 3]):
            for x in range(boxes[g, 0], boxes[g, 1]):
                counts[y * n_x + x + 1] += 1
    starts = np.cumsum(counts)
    fill = starts[:-1].copy()
    lists = np.empty(starts[-1], np.int64)
    for g in order:
        for y in range(boxes[g, 2], boxes[g, 3]):
            for x in range(boxes[g, 0], boxes[g, 1]):
                lists[fill[y * n_x + x]] = g
                fill[y * n_x + x] += 1
    return starts, lists


@njit(parallel=True, cache=True, fastmath=True)
def _forward(starts, order, pixels, conics, opacities, colors, image, last, transmittance):  # type: ignore[no-untyped-def]
    height, width, n_channels = image.shape
    n_x = (width + TILE - 1) // TILE
    for tile in prange(len(starts) - 1):
        for i in range(TILE * TILE):
            x, y = (tile % n_x) * TILE + i % TILE, (tile // n_x) * TILE + i // TILE
            if x >= width or y >= height:
                continue
            t = np.float32(1.0)
            for pair in range(starts[tile], starts[tile + 1]):
                g = order[pair]
                dx, dy = x + np.float32(0.5) - pixels[g, 0], y + np.float32(0.5) - pixels[g, 1]
                power = np.float32(-0.5) * (conics[g, 0] * dx * dx + conics[g, 2] * dy * dy) - conics[g, 1] * dx * dy
                if power > 0:
                    continue
                alpha = min(_ALPHA_MAX, opacities[g] * math.exp(power))
                if alpha < _ALPHA_MIN:
                    continue
                t_next = t * (np.float32(1.0) - alpha)
                if t_next < _T_MIN:
                    break
                for k in range(n_channels):
                    image[y, x, k] += colors[g, k] * alpha * t
                t = t_next
                last[y, x] = pair - starts[tile] + 1
            transmittance[y, x] = t


@njit(parallel=True, cache=True, fastmath=True)
def _backward(starts, order, pixels, conics, opacities, colors, upstream, last, transmittance, pairs):  # type: ignore[no-untyped-def]
    height, width, n_channels = upstream.shape
    n_x = (width + TILE - 1) // TILE
    for tile in prange(len(starts) - 1):
        behind = np.zeros(n_channels, np.float32)
        for i in range(TILE * TILE):
            x, y = (tile % n_x) * TILE + i % TILE, (tile // n_x) * TILE + i // TILE
            if x >= width or y >= height:
                continue
            t = transmittance[y, x]
            behind[:] = np.float32(0.0)
            for pair in range(starts[tile] + last[y, x] - 1, starts[tile] - 1, -1):
                g = order[pair]
                dx, dy = x + np.float32(0.5) - pixels[g, 0], y + np.float32(0.5) - pixels[g, 1]
                power = np.float32(-0.5) * (conics[g, 0] * dx * dx + conics[g, 2] * dy * dy) - conics[g, 1] * dx * dy
                if power > 0:
                    continue
                density = math.exp(power)
                alpha = min(_ALPHA_MAX, opacities[g] * density)
                if alpha < _ALPHA_MIN:
                    continue
                t = t / (np.float32(1.0) - alpha)
                d_alpha = np.float32(0.0)
                for k in range(n_channels):
                    d_alpha += (colors[g, k] - behind[k]) * upstream[y, x, k]
                    pairs[pair, 6 + k] += alpha * t * upstream[y, x, k]
                    behind[k] = alpha * colors[g, k] + (np.float32(1.0) - alpha) * behind[k]
                d_alpha *= t
                d_power = d_alpha * alpha
                pairs[pair, 0] += d_power * (conics[g, 0] * dx + conics[g, 1] * dy)
                pairs[pair, 1] += d_power * (conics[g, 2] * dy + conics[g, 1] * dx)
                pairs[pair, 2] += np.float32(-0.5) * d_power * dx * dx
                pairs[pair, 3] -= d_power * dx * dy
                pairs[pair, 4] += np.float32(-0.5) * d_power * dy * dy
                pairs[pair, 5] += d_alpha * density


@njit(cache=True)
def _sum_pairs(order, pairs, gradients):  # type: ignore[no-untyped-def]
    for pair in range(len(order)):
        for k in range(pairs.shape[1]):
            gradients[order[pair], k] += pairs[pair, k]
