"""Kernels of SSIM (11x11 Gaussian window, sigma 1.5, zero padding) and L1, with their gradients, in strips of rows.

Wang et al. 2004. With blur G, a = G x, b = G y, s_xx = G x^2 - a^2, s_xy = G xy - a b and likewise s_yy::

    SSIM = A1 A2 / (B1 B2);  A1 = 2 a b + C1, A2 = 2 s_xy + C2, B1 = a^2 + b^2 + C1, B2 = s_xx + s_yy + C2
    dSSIM/dx = G p + 2 x G q + y G r    (G is symmetric)
    q = -SSIM / B2,  r = 2 A1 / (B1 B2),  p = 2 b A2 / (B1 B2) - 2 a SSIM / B1 - 2 a q - b r

Images are stored as planes, one for each channel. A row is padded to a multiple of 16 pixels and with 16 zeros on both
sides; a plane has 5 rows of zeros above and below. Each pixel has a weight, which is zero outside of the image.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ...core.arrays import Float32
from ...rasterizer import INNER, JIT, Share, fma, load, select, splat, store, take_range

f4 = np.float32

PAD = 16
"""Number of zeros on each side of a row: one vector, so that loads around a pixel stay within the array."""

BORDER = 5
"""Number of rows of zeros above and below an image: half of the window."""

STRIP = 32
"""Number of rows that are blurred together. The scratch memory of a strip fits the second-level cache."""

_TAPS = [math.exp(-((i - 5.0) ** 2) / 4.5) for i in range(11)]
SSIM_WINDOW = tuple(f4(tap / sum(_TAPS)) for tap in _TAPS[:6])
"""Weights of the window, from its end to its middle; the other half is the same."""

SSIM_C1, SSIM_C2 = f4(0.01**2), f4(0.03**2)
"""Constants that keep the quotients of SSIM finite, for values in [0, 1] (Wang et al. 2004)."""

_K0, _K1, _K2, _K3, _K4, _K5 = SSIM_WINDOW


def plane_layout(height: int, width: int) -> tuple[int, int, int]:
    """Return the number of floats of a padded row without its margins, with its margins, and of a padded plane."""
    inner = (width + 15) // 16 * 16
    row = inner + 2 * PAD
    return inner, row, row * (height + 2 * BORDER)


_kernel_plane_layout = njit(**INNER)(plane_layout)
"""`plane_layout` for calls from kernels."""


@njit(**INNER)
def _blur_at(source: Float32, at: int, step: int) -> object:
    """Return the blur of ``source[at:at + 16]`` with 11 taps that are `step` floats apart.

    `step` is 1 for a horizontal blur and the length of a row for a vertical one.
    """
    total = load(source, at) * _K5
    total = fma(load(source, at - step) + load(source, at + step), splat(_K4), total)
    total = fma(load(source, at - 2 * step) + load(source, at + 2 * step), splat(_K3), total)
    total = fma(load(source, at - 3 * step) + load(source, at + 3 * step), splat(_K2), total)
    total = fma(load(source, at - 4 * step) + load(source, at + 4 * step), splat(_K1), total)
    return fma(load(source, at - 5 * step) + load(source, at + 5 * step), splat(_K0), total)


@njit(**INNER)
def _blur_row(source: Float32, at: int, row: int, target: Float32, target_at: int) -> None:
    """Blur a row of `row` floats, a multiple of 16, horizontally."""
    for i in range(0, row, 16):
        store(target, target_at + i, _blur_at(source, at + i, 1))


@njit(**JIT)
def fill_planes(
    share: Share, pixels: Float32, pixel_step: int, weights: Float32, height: int, width: int, planes: Float32
) -> None:
    """Copy the first 3 channels of flat `pixels`, `pixel_step` floats apart, into 3 padded `planes`.

    Pixels of weight zero become zero.
    """
    inner, row, plane = _kernel_plane_layout(height, width)
    zero = splat(f4(0.0))
    padded_y, end = take_range(share, height + 2 * BORDER, 1)
    while padded_y < end:
        y = padded_y - BORDER
        for c in range(3):
            at = c * plane + padded_y * row
            if y < 0 or y >= height:
                for i in range(0, row, 16):
                    store(planes, at + i, zero)
                continue
            store(planes, at, zero)
            store(planes, at + row - 2 * PAD, zero)
            store(planes, at + row - PAD, zero)
            source = np.int64(y) * width * pixel_step + c
            for x in range(width):
                if weights[y * inner + x] > f4(0.0):
                    planes[at + PAD + x] = pixels[source + x * pixel_step]
                else:
                    planes[at + PAD + x] = f4(0.0)
        padded_y, end = take_range(share, height + 2 * BORDER, 1)


@njit(**JIT)
def blur_target(share: Share, planes: Float32, height: int, width: int, means: Float32, variances: Float32) -> None:
    """Fill `means` (b) and `variances` (s_yy) in this thread's strips of the 3 padded planes y of a target."""
    inner, row, plane = _kernel_plane_layout(height, width)
    n_strips = (height + STRIP - 1) // STRIP
    squares = np.zeros(row, np.float32)
    blurred = np.empty(2 * (STRIP + 2 * BORDER) * inner, np.float32)
    task, end = take_range(share, 3 * n_strips, 1)
    while task < end:
        c = task // n_strips
        top = (task - c * n_strips) * STRIP
        n_rows = min(STRIP, height - top)
        part = (STRIP + 2 * BORDER) * inner
        for k in range(n_rows + 2 * BORDER):
            at = c * plane + (top + k) * row
            for i in range(PAD, PAD + inner, 16):
                y = load(planes, at + i)
                store(squares, i, y * y)
            _blur_row(planes, at + PAD, inner, blurred, k * inner)
            _blur_row(squares, PAD, inner, blurred, part + k * inner)
        for k in range(n_rows):
            at = c * plane + (top + BORDER + k) * row + PAD
            middle = (k + BORDER) * inner
            for i in range(0, inner, 16):
                b = _blur_at(blurred, middle + i, inner)
                store(means, at + i, b)
                store(variances, at + i, _blur_at(blurred, part + middle + i, inner) - b * b)
        task, end = take_range(share, 3 * n_strips, 1)


@njit(**INNER)
def _clear_margins(maps: Float32, at: int, row: int) -> None:
    """Set the margins on both sides of a row of a map to zero."""
    zero = splat(f4(0.0))
    store(maps, at, zero)
    store(maps, at + row - PAD, zero)


@njit(**JIT)
def similarity_and_maps(
    share: Share,
    image: Float32,
    target: Float32,
    target_means: Float32,
    target_variances: Float32,
    weights: Float32,
    height: int,
    width: int,
    maps: Float32,
    totals: NDArray[np.float64],
) -> None:
    """Compare `image` with `target`, both 3 padded planes, in this thread's strips.

    Row ``channel * n_strips + strip`` of `totals` [3 n_strips, 2] gets the weighted sums of SSIM and of |x - y|. `maps`
    gets the weighted p, q and r, 3 padded planes each, one map after another.
    """
    inner, row, plane = _kernel_plane_layout(height, width)
    n_strips = (height + STRIP - 1) // STRIP
    squares = np.zeros(row, np.float32)
    products = np.zeros(row, np.float32)
    part = (STRIP + 2 * BORDER) * inner
    blurred = np.empty(3 * part, np.float32)
    lanes16 = np.empty(32, np.float32)
    zero = splat(f4(0.0))
    one = splat(f4(1.0))
    two = f4(2.0)
    task, end = take_range(share, 3 * n_strips, 1)
    while task < end:
        c = task // n_strips
        strip = task - c * n_strips
        top = strip * STRIP
        n_rows = min(STRIP, height - top)
        for k in range(n_rows + 2 * BORDER):
            at = c * plane + (top + k) * row
            for i in range(PAD, PAD + inner, 16):
                x = load(image, at + i)
                store(squares, i, x * x)
                store(products, i, x * load(target, at + i))
            _blur_row(image, at + PAD, inner, blurred, k * inner)
            _blur_row(squares, PAD, inner, blurred, part + k * inner)
            _blur_row(products, PAD, inner, blurred, 2 * part + k * inner)
        total_similarity = 0.0
        total_difference = 0.0
        for k in range(n_rows):
            row_at = c * plane + (top + BORDER + k) * row
            for m in range(3):
                _clear_margins(maps, 3 * m * plane + row_at, row)
            middle = (k + BORDER) * inner
            row_similarity = zero
            row_difference = zero
            for i in range(0, inner, 16):
                at = row_at + PAD + i
                weight = load(weights, (top + k) * inner + i)
                a = _blur_at(blurred, middle + i, inner)
                b = load(target_means, at)
                s_xx = _blur_at(blurred, part + middle + i, inner) - a * a
                s_xy = _blur_at(blurred, 2 * part + middle + i, inner) - a * b
                numerator_1 = a * b * two + SSIM_C1
                numerator_2 = s_xy * two + SSIM_C2
                inverse_1 = one / (fma(a, a, b * b) + SSIM_C1)
                inverse_2 = one / (s_xx + load(target_variances, at) + SSIM_C2)
                inverse = inverse_1 * inverse_2
                similarity = numerator_1 * numerator_2 * inverse
                q = (zero - similarity) * inverse_2
                r = numerator_1 * inverse * two
                p = (b * numerator_2 * inverse - a * similarity * inverse_1 - a * q) * two - b * r
                row_similarity = fma(similarity, weight, row_similarity)
                store(maps, at, p * weight)
                store(maps, at + 3 * plane, q * weight)
                store(maps, at + 6 * plane, r * weight)
                difference = load(image, at) - load(target, at)
                difference = select(difference < zero, zero - difference, difference)
                row_difference = fma(difference, weight, row_difference)
            store(lanes16, 0, row_similarity)
            store(lanes16, 16, row_difference)
            for i in range(16):
                total_similarity += lanes16[i]
                total_difference += lanes16[16 + i]
        totals[task, 0] = total_similarity
        totals[task, 1] = total_difference
        for m in range(3):
            start = 3 * m * plane + c * plane
            if strip == 0:
                for i in range(0, BORDER * row, 16):
                    store(maps, start + i, zero)
            if strip == n_strips - 1:
                for i in range((height + BORDER) * row, plane, 16):
                    store(maps, start + i, zero)
        task, end = take_range(share, 3 * n_strips, 1)


@njit(**JIT)
def difference_gradient(
    share: Share,
    image: Float32,
    target: Float32,
    weights: Float32,
    maps: Float32,
    height: int,
    width: int,
    similarity_factor: float,
    difference_factor: float,
    gradient: Float32,
) -> None:
    """Fill flat `gradient` [H W 3] with similarity_factor dSSIM/dx + difference_factor d|x - y|/dx, both weighted.

    `maps` are those of `similarity_and_maps`.
    """
    inner, row, plane = _kernel_plane_layout(height, width)
    n_strips = (height + STRIP - 1) // STRIP
    part = (STRIP + 2 * BORDER) * inner
    blurred = np.empty(3 * part, np.float32)
    line = np.empty(inner, np.float32)
    zero = splat(f4(0.0))
    scale = splat(f4(similarity_factor))
    plus = splat(f4(difference_factor))
    minus = splat(f4(-difference_factor))
    task, end = take_range(share, 3 * n_strips, 1)
    while task < end:
        c = task // n_strips
        top = (task - c * n_strips) * STRIP
        n_rows = min(STRIP, height - top)
        for k in range(n_rows + 2 * BORDER):
            at = c * plane + (top + k) * row + PAD
            for m in range(3):
                _blur_row(maps, 3 * m * plane + at, inner, blurred, m * part + k * inner)
        for k in range(n_rows):
            at = c * plane + (top + BORDER + k) * row + PAD
            middle = (k + BORDER) * inner
            for i in range(0, inner, 16):
                x = load(image, at + i)
                y = load(target, at + i)
                slope = _blur_at(blurred, middle + i, inner)
                slope = fma((x + x), _blur_at(blurred, part + middle + i, inner), slope)
                slope = fma(y, _blur_at(blurred, 2 * part + middle + i, inner), slope)
                sign = select(x > y, plus, select(x < y, minus, zero))
                weight = load(weights, (top + k) * inner + i)
                store(line, i, select(weight > zero, fma(slope, scale, sign * weight), zero))
            pixel = np.int64(top + k) * width * 3 + c
            for x_at in range(width):
                gradient[pixel + 3 * x_at] = line[x_at]
        task, end = take_range(share, 3 * n_strips, 1)
