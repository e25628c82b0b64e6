"""Backward pass of blending: the gradient of each pair of a tile and a Gaussian, in two sweeps over each 4x4 block.

With g = dL/dC of a pixel, the first sweep runs front to back, so that T is not rebuilt by division, and the second one
back to front::

    w_i = alpha_i T_i,   e_i = w_i (color_i . g)
    R_i = dL/dT_final T_final + sum_{j > i} e_j              one scalar per pixel for any number of channels
    dL/dcolor_i = sum over pixels of w_i g
    s_i = alpha_i dL/dalpha_i = e_i - R_i alpha_i / (1 - alpha_i)           (zero where alpha was clamped)

Summing R from the back keeps the gradients of Gaussians behind nearly opaque ones exact. Subtracting from g . C_final
in a single sweep would give them a rounding error relative to g . C_final. The sums over pixels of s times
1, u, v, u^2, u v, v^2 are all that `projection_backward` needs for opacity, centre and covariance.

The thresholds are tested by the functions of `blend_forward`, so both passes agree to the bit.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..core.arrays import Float32
from .blend_forward import (
    GEOMETRY_SIZE,
    PREFETCH_DISTANCE,
    TILES_PER_RANGE,
    cover,
    lane_x,
    lane_y,
    list_block_gaussians,
    longest_list,
    prefetch_block,
    prefetch_colors,
    whitened_offsets,
)
from .jit import INNER, JIT
from .settings import ALPHA_MAX
from .simd import (
    any_of,
    fma,
    item,
    load,
    maximum,
    negative,
    put,
    select,
    splat,
    store,
)
from .simd_pixels import load_pixels4, store_sums4
from .threads import Share, take_range
from .tile_spans import TILE

f4 = np.float32

MOMENTS_SIZE = 8
"""Number of floats before the colour gradients in a pair's row: the sums of s, su, sv, suu, suv, svv, and two zeros."""

_ALPHA_MAX = f4(ALPHA_MAX)


@njit(**INNER)
def _read_block(
    image: Float32, corner: int, width: int, n_x: int, n_y: int, n_channels: int, planes: Float32, at: int
) -> None:
    """Copy a 4x4 block of flat `image` [H W n_channels] to ``planes[at:]``, one vector for each channel.

    Lanes outside of the image (n_x or n_y below 4) and channels up to the next multiple of 4 keep their zeros.
    """
    row_step = np.int64(width) * n_channels
    start = corner * n_channels
    if n_x == 4 and n_y == 4 and n_channels >= 4:
        for chunk in range(0, n_channels, 4):
            first = min(chunk, n_channels - 4)  # The last four channels overlap the previous four.
            load_pixels4(image, start + first, row_step, np.int64(n_channels), planes, np.int64(at + first * 16))
        return
    for y in range(n_y):
        for x in range(n_x):
            for k in range(n_channels):
                put(planes, at + k * 16 + 4 * y + x, item(image, start + k + y * row_step + x * n_channels))


@njit(**INNER)
def _store_pairs(
    start: int,
    n: int,
    n_colors: int,
    tile_chunks: int,
    moments: Float32,
    gradient: Float32,
    weights: Float32,
    entries: NDArray[np.int64],
    n_entries: NDArray[np.int64],
    pair_gradients: Float32,
) -> None:
    """Sum over the lanes and write the rows of a tile's pairs. Gradients of colours are summed over blocks here."""
    zero = splat(f4(0.0))
    for j in range(n):
        row = (start + j) * (MOMENTS_SIZE + n_colors)
        at = j * 96
        store_sums4(
            pair_gradients, row, load(moments, at), load(moments, at + 16), load(moments, at + 32),
            load(moments, at + 48),
        )  # fmt: skip
        store_sums4(pair_gradients, row + 4, load(moments, at + 64), load(moments, at + 80), zero, zero)
        first = j * 32
        stop = first + 2 * n_entries[j]
        for k in range(0, n_colors - 4, 8):  # Eight channels at a time, so that a weight is loaded once for all eight.
            g0 = zero
            g1 = zero
            g2 = zero
            g3 = zero
            g4 = zero
            g5 = zero
            g6 = zero
            g7 = zero
            if (tile_chunks >> (k >> 2)) & 3 != 0:
                for i in range(first, stop, 2):
                    weight = load(weights, item(entries, i))
                    at = item(entries, i + 1) + k * 16
                    g0 = fma(weight, load(gradient, at), g0)
                    g1 = fma(weight, load(gradient, at + 16), g1)
                    g2 = fma(weight, load(gradient, at + 32), g2)
                    g3 = fma(weight, load(gradient, at + 48), g3)
                    g4 = fma(weight, load(gradient, at + 64), g4)
                    g5 = fma(weight, load(gradient, at + 80), g5)
                    g6 = fma(weight, load(gradient, at + 96), g6)
                    g7 = fma(weight, load(gradient, at + 112), g7)
            store_sums4(pair_gradients, row + MOMENTS_SIZE + k, g0, g1, g2, g3)
            store_sums4(pair_gradients, row + MOMENTS_SIZE + k + 4, g4, g5, g6, g7)
        # The last four channels. One function for both loops makes the backward pass of RGB a sixth slower.
        if n_colors & 4 != 0:
            k = n_colors - 4
            g0 = zero
            g1 = zero
            g2 = zero
            g3 = zero
            if (tile_chunks >> (k >> 2)) & 1 != 0:
                for i in range(first, stop, 2):
                    weight = load(weights, item(entries, i))
                    at = item(entries, i + 1) + k * 16
                    g0 = fma(weight, load(gradient, at), g0)
                    g1 = fma(weight, load(gradient, at + 16), g1)
                    g2 = fma(weight, load(gradient, at + 32), g2)
                    g3 = fma(weight, load(gradient, at + 48), g3)
            store_sums4(pair_gradients, row + MOMENTS_SIZE + k, g0, g1, g2, g3)


@njit(**JIT)
def blend_tiles_backward(
    share: Share,
    tiles: NDArray[np.int32],
    width: int,
    height: int,
    tile_start: NDArray[np.int64],
    gaussians: NDArray[np.int32],
    geometry: Float32,
    colors: Float32,
    n_colors: int,
    n_channels: int,
    n_moving: int,
    masks: NDArray[np.uint16],
    image_gradient: Float32,
    transmittance_gradient: Float32,
    pair_gradients: Float32,
) -> int:
    """Fill the rows of flat `pair_gradients` [M (MOMENTS_SIZE + n_colors)] of this thread's share of `tiles`.

    `masks` and `geometry` are those of the forward pass. `transmittance_gradient` is flat [H W], or empty if it is zero
    everywhere. The gradients of the channels from `n_moving` on reach their colours and not the moments. Returns in how
    many blocks the incoming gradient is not finite.
    """
    n_columns = (width + TILE - 1) // TILE
    n_tiles = tiles.shape[0]
    n_pairs = gaussians.shape[0]
    longest = longest_list(tiles, tile_start)
    block_length = n_colors * 16
    mixed_at = 16 * block_length  # The four channels of which only some move, with zeros in place of the others.
    gradient = np.empty(mixed_at + 64, np.float32)
    by_transmittance = np.zeros(256, np.float32)
    # Four channels that have a gradient in the block and move: the first of them, and the index of their gradient.
    present = np.empty(n_colors // 4, np.int64)
    present_at = np.empty(n_colors // 4, np.int64)
    color_rows = np.empty(longest, np.int64)
    queue = np.empty(longest + 16, np.int32)
    moments = np.empty(longest * 96, np.float32)
    swept = np.empty(longest * 32 + 32, np.float32)  # For each Gaussian of a block: e, and alpha / (1 - alpha) or 0.
    weights = np.empty(longest * 256 + 16, np.float32)  # w of each Gaussian in each block that it changes.
    entries = np.empty(longest * 32, np.int64)  # For each w: its index, and the index of its block's gradient.
    n_entries = np.empty(longest, np.int64)
    zero = splat(f4(0.0))
    one = splat(f4(1.0))
    n_bad = 0
    first, last = take_range(share, n_tiles, TILES_PER_RANGE)
    while first < last:
        for t in tiles[first:last]:
            x0 = (t % n_columns) * TILE
            y0 = (t // n_columns) * TILE
            start = tile_start[t]
            n = tile_start[t + 1] - start
            if n == 0:
                continue
            if x0 + TILE > width or y0 + TILE > height or n_channels % 4 != 0:
                gradient[:] = f4(0.0)
                by_transmittance[:] = f4(0.0)
            placed = start * GEOMETRY_SIZE
            for j in range(n):
                ahead = np.int64(item(gaussians, min(start + j + PREFETCH_DISTANCE, n_pairs - 1)))
                prefetch_colors(ahead, colors, n_colors)
                color_rows[j] = np.int64(gaussians[start + j]) * n_colors
            n_entries[:n] = 0
            for k in range(6 * n):
                store(moments, k * 16, zero)
            tile_chunks = np.int64(0)  # With a plain 0, Numba would compile `_store_pairs` a second time.
            n_weights = 0
            for block in range(16):
                left = x0 + 4 * (block % 4)
                top = y0 + 4 * (block // 4)
                n_x = min(4, width - left)
                n_y = min(4, height - top)
                if n_x <= 0 or n_y <= 0:
                    continue
                corner = np.int64(top) * width + left
                gradient_at = block * block_length
                _read_block(image_gradient, corner, width, n_x, n_y, n_channels, gradient, gradient_at)
                # Prefetch the next block; after the last block, the first one of the tile to the right.
                next_x, next_y = (
                    (x0 + 4 * ((block + 1) % 4), y0 + 4 * ((block + 1) // 4)) if block < 15 else (x0 + TILE, y0)
                )
                prefetch_block(image_gradient, np.int64(next_y) * width + next_x, width, n_channels)
                if transmittance_gradient.shape[0] > 0:
                    _read_block(transmittance_gradient, corner, width, n_x, n_y, 1, by_transmittance, block * 16)
                rest = load(by_transmittance, block * 16)
                active = any_of(rest != zero)
                probe = rest
                n_present = 0
                any_color = False
                for chunk in range(0, n_colors, 4):
                    at = gradient_at + chunk * 16
                    g0 = load(gradient, at)
                    g1 = load(gradient, at + 16)
                    g2 = load(gradient, at + 32)
                    g3 = load(gradient, at + 48)
                    if any_of((g0 != zero) | (g1 != zero) | (g2 != zero) | (g3 != zero)):
                        any_color = True
                        if chunk < n_moving:
                            present[n_present] = chunk
                            present_at[n_present] = at
                            if n_moving < chunk + 4 and n_moving < n_channels:
                                present_at[n_present] = mixed_at
                                for k in range(4):
                                    moves = chunk + k < n_moving
                                    store(gradient, mixed_at + k * 16, load(gradient, at + k * 16) if moves else zero)
                            n_present += 1
                        tile_chunks |= 1 << (chunk >> 2)
                        probe = probe + ((g0 + g1) + (g2 + g3))
                if any_of((probe - probe) != zero):  # inf - inf and NaN - NaN are NaN, which differs from zero.
                    n_bad += 1
                if not any_color and not active:
                    continue
                n_queue = list_block_gaussians(masks, start, n, block, queue)
                px = lane_x() + f4(4 * (block % 4))
                py = lane_y() + f4(4 * (block // 4))
                t_now = one
                for i in range(n_queue):
                    j = int(item(queue, i))
                    at = placed + j * GEOMETRY_SIZE
                    u, v = whitened_offsets(px, py, geometry, at)
                    raw, alpha, weight, stop, t_now = cover(u, v, item(geometry, at + 5), t_now)
                    ratio = alpha / (one - alpha)
                    store(swept, i * 32 + 16, select(stop, zero, select(raw <= _ALPHA_MAX, ratio, zero)))
                    store(weights, n_weights * 16, weight)
                    entry = item(n_entries, j)
                    put(n_entries, j, entry + 1)
                    put(entries, j * 32 + 2 * entry, n_weights * 16)
                    put(entries, j * 32 + 2 * entry + 1, gradient_at)
                    n_weights += 1
                # e of two Gaussians together, so that the incoming gradient is loaded once for both. If their number is
                # odd, the last one is paired with itself, and the second result is not read.
                put(queue, n_queue, item(queue, max(n_queue - 1, 0)))
                weights_at = (n_weights - n_queue) * 16
                for i in range(0, n_queue, 2):
                    color_at = item(color_rows, int(item(queue, i)))
                    second_at = item(color_rows, int(item(queue, i + 1)))
                    dot = zero
                    odd = zero
                    second_dot = zero
                    second_odd = zero
                    for c in range(n_present):
                        k = item(present, c)
                        at = item(present_at, c)
                        g0 = load(gradient, at)
                        g1 = load(gradient, at + 16)
                        g2 = load(gradient, at + 32)
                        g3 = load(gradient, at + 48)
                        dot = fma(g0, splat(item(colors, color_at + k)), dot)
                        odd = fma(g1, splat(item(colors, color_at + k + 1)), odd)
                        dot = fma(g2, splat(item(colors, color_at + k + 2)), dot)
                        odd = fma(g3, splat(item(colors, color_at + k + 3)), odd)
                        second_dot = fma(g0, splat(item(colors, second_at + k)), second_dot)
                        second_odd = fma(g1, splat(item(colors, second_at + k + 1)), second_odd)
                        second_dot = fma(g2, splat(item(colors, second_at + k + 2)), second_dot)
                        second_odd = fma(g3, splat(item(colors, second_at + k + 3)), second_odd)
                    store(swept, i * 32, load(weights, weights_at + i * 16) * (dot + odd))
                    store(swept, i * 32 + 32, load(weights, weights_at + i * 16 + 16) * (second_dot + second_odd))
                rest = rest * maximum(t_now, negative(t_now))
                for i in range(n_queue - 1, -1, -1):
                    j = int(item(queue, i))
                    at = placed + j * GEOMETRY_SIZE
                    u, v = whitened_offsets(px, py, geometry, at)
                    ratio = load(swept, i * 32 + 16)
                    e = load(swept, i * 32)
                    s = select(ratio > zero, fma(negative(rest), ratio, e), zero)
                    rest = rest + e
                    su = s * u
                    sv = s * v
                    at = j * 96
                    store(moments, at, load(moments, at) + s)
                    store(moments, at + 16, load(moments, at + 16) + su)
                    store(moments, at + 32, load(moments, at + 32) + sv)
                    store(moments, at + 48, fma(su, u, load(moments, at + 48)))
                    store(moments, at + 64, fma(su, v, load(moments, at + 64)))
                    store(moments, at + 80, fma(sv, v, load(moments, at + 80)))
            _store_pairs(
                start, n, n_colors, tile_chunks, moments, gradient, weights, entries, n_entries, pair_gradients
            )  # fmt: skip
        first, last = take_range(share, n_tiles, TILES_PER_RANGE)
    return n_bad
