"""The rasterizer as textbooks and the first CUDA code have it, in plain Numba: the yardstick of `benchmarks.raster`.

Square tile rectangles of three standard deviations, one scalar loop over pixels and Gaussians, and a backward pass
from back to front that rebuilds the transmittance by division (Kerbl et al. 2023). Blending only: it is given ellipses
on the screen and returns gradients of those, which leaves projection and harmonics out of its time, in its favour.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

__all__ = ["Ellipses", "TextbookRaster"]

TILE = 16
Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class Ellipses:
    """Gaussians on the screen: centres [N, 2] px, inverse covariances xx, xy, yy [N, 3], opacity and depth [N]."""

    pixels: Float32
    conics: Float32
    opacities: Float32
    depths: Float32
    radii: Float32


class TextbookRaster:
    """Forward and backward of `ellipses` with `colors` [N, K] in a picture of `width` x `height`."""

    def __init__(self, ellipses: Ellipses, colors: Float32, width: int, height: int) -> None:
        self.ellipses, self.colors, self.width, self.height = ellipses, colors, width, height

    def forward_backward(self, upstream: Float32) -> tuple[Float32, Float32]:
        """Return the picture [H, W, K] and the gradients [N, 6 + K] of centre, conic, opacity and colour."""
        e = self.ellipses
        starts, order = _bin(e.pixels, e.radii, e.depths, self.width, self.height)
        image = np.zeros((self.height, self.width, self.colors.shape[1]), np.float32)
        last = np.zeros((self.height, self.width), np.int32)
        rest = np.ones((self.height, self.width), np.float32)
        _forward(starts, order, e.pixels, e.conics, e.opacities, self.colors, image, last, rest)
        pairs = np.zeros((len(order), 6 + self.colors.shape[1]), np.float32)
        _backward(starts, order, e.pixels, e.conics, e.opacities, self.colors, upstream, last, rest, pairs)
        gradients = np.zeros((len(self.colors), pairs.shape[1]), np.float32)
        _sum_pairs(order, pairs, gradients)
        return image, gradients


@njit(cache=True)
def _bin(
    pixels: Float32, radii: Float32, depths: Float32, width: int, height: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return where each tile's list begins [tiles + 1], and the lists of Gaussians, near ones first."""
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
def _forward(starts, order, pixels, conics, opacities, colors, image, last, rest):  # type: ignore[no-untyped-def]
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
                alpha = min(np.float32(0.99), opacities[g] * math.exp(power))
                if alpha < np.float32(1.0 / 255.0):
                    continue
                t_next = t * (np.float32(1.0) - alpha)
                if t_next < np.float32(1e-4):
                    break
                for k in range(n_channels):
                    image[y, x, k] += colors[g, k] * alpha * t
                t = t_next
                last[y, x] = pair - starts[tile] + 1
            rest[y, x] = t


@njit(parallel=True, cache=True, fastmath=True)
def _backward(starts, order, pixels, conics, opacities, colors, upstream, last, rest, pairs):  # type: ignore[no-untyped-def]
    height, width, n_channels = upstream.shape
    n_x = (width + TILE - 1) // TILE
    for tile in prange(len(starts) - 1):
        behind = np.zeros(n_channels, np.float32)
        for i in range(TILE * TILE):
            x, y = (tile % n_x) * TILE + i % TILE, (tile // n_x) * TILE + i // TILE
            if x >= width or y >= height:
                continue
            t = rest[y, x]
            behind[:] = np.float32(0.0)
            for pair in range(starts[tile] + last[y, x] - 1, starts[tile] - 1, -1):
                g = order[pair]
                dx, dy = x + np.float32(0.5) - pixels[g, 0], y + np.float32(0.5) - pixels[g, 1]
                power = np.float32(-0.5) * (conics[g, 0] * dx * dx + conics[g, 2] * dy * dy) - conics[g, 1] * dx * dy
                if power > 0:
                    continue
                density = math.exp(power)
                alpha = min(np.float32(0.99), opacities[g] * density)
                if alpha < np.float32(1.0 / 255.0):
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
