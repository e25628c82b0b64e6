"""Forward pass of blending. A tile of 16x16 pixels has 16 blocks of 4x4 pixels, one pixel in each lane of a vector.

Per pixel, front to back (Kerbl et al. 2023, eq. 3)::

    alpha = min(0.99, opacity 2^-(u^2 + v^2)),  0 when below 1/255;     u = a dx + b dy,  v = c dy
    C    += alpha T color;   T *= 1 - alpha;    stop before the Gaussian that would make T < 1e-4

A finished lane holds -T. Each pair of a tile and a Gaussian gets a 16-bit mask of the blocks that it changes. A
closest-point test sets the mask before blending, and blending clears the bits of blocks that did not change. The
backward pass visits only the blocks that are left.

The Gaussians of a tile and the rows of its pixels are scattered in memory, so both passes prefetch them. See
docs/design_notes/rasterizer.md.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..core.arrays import Float32
from .jit import INNER, JIT
from .settings import ALPHA_MAX, ALPHA_MIN, T_MIN
from .simd import (
    Vec,
    all_bits,
    any_of,
    exp2_negative,
    fma,
    item,
    lanes,
    load,
    load_bit,
    maximum,
    minimum,
    minimum_with,
    negative,
    negative_abs,
    prefetch,
    put,
    put_selected,
    select,
    splat,
    store,
)
from .simd_pixels import store_pixels4
from .threads import Share, take_range
from .tile_spans import LIMIT_MARGIN, TILE

f4 = np.float32

BATCH_SIZE = 64
"""Number of Gaussians whose weights are stored before their colours are added. It bounds a block's scratch memory."""

GEOMETRY_SIZE = 8
"""Number of floats that describe a Gaussian relative to a tile, see `_write_geometry`."""

PREFETCH_DISTANCE = 8
"""How many Gaussians ahead of the current one memory is prefetched."""

TILES_PER_RANGE = 8
"""Number of neighbouring tiles that a thread takes together, because they share Gaussians and therefore cache lines."""

lane_x = lanes([i % 4 + 0.5 for i in range(16)])
lane_y = lanes([i // 4 + 0.5 for i in range(16)])
_clamp_to_alpha_max = minimum_with(ALPHA_MAX)
_lane_number = lanes(list(range(16)))
_block_x = lanes([4 * (b % 4) + 0.5 for b in range(16)])
_block_y = lanes([4 * (b // 4) + 0.5 for b in range(16)])

_ALPHA_MIN, _T_MIN = f4(ALPHA_MIN), f4(T_MIN)


@njit(**INNER)
def _write_geometry(
    g: int,
    x0: int,
    y0: int,
    pixels: NDArray[np.float64],
    roots: NDArray[np.float64],
    opacities: Float32,
    geometry: Float32,
    at: int,
) -> None:
    """Write Gaussian `g` relative to the tile at pixel (x0, y0) to ``geometry[at:]``: x, y, a, b, c, opacity, u0, v0.

    (x, y) is the point of the tile nearest to the centre of the Gaussian, and (u0, v0) is (u, v) there. Both passes
    compute u = a dx + b dy + u0, v = c dy + v0 with (dx, dy) relative to that point. Relative to a centre that is 10^4
    pixels away, a needle-shaped Gaussian would lose four of the seven digits of float32.
    """
    x = item(pixels, 2 * g) - x0
    y = item(pixels, 2 * g + 1) - y0
    a = item(roots, 3 * g)
    b = item(roots, 3 * g + 1)
    c = item(roots, 3 * g + 2)
    near_x = f4(min(max(x, 0.0), np.float64(TILE)))
    near_y = f4(min(max(y, 0.0), np.float64(TILE)))
    dx = near_x - x
    dy = near_y - y
    put(geometry, at, near_x)
    put(geometry, at + 1, near_y)
    put(geometry, at + 2, f4(a))
    put(geometry, at + 3, f4(b))
    put(geometry, at + 4, f4(c))
    put(geometry, at + 5, item(opacities, g))
    put(geometry, at + 6, f4(a * dx + b * dy))
    put(geometry, at + 7, f4(c * dy))


@njit(**INNER)
def _prefetch_ellipse(g: int, pixels: NDArray[np.float64], roots: NDArray[np.float64], opacities: Float32) -> None:
    """Prefetch the values of Gaussian `g` that `_write_geometry` reads."""
    prefetch(pixels, 2 * g)
    prefetch(roots, 3 * g)
    prefetch(roots, 3 * g + 2)
    prefetch(opacities, g)


@njit(**INNER)
def prefetch_colors(g: int, colors: Float32, n_colors: int) -> None:
    """Prefetch the `n_colors` values of Gaussian `g` in flat `colors`."""
    for at in range(0, n_colors + 15, 16):
        prefetch(colors, g * n_colors + at)


@njit(**INNER)
def list_block_gaussians(masks: NDArray[np.uint16], start: int, n: int, block: int, queue: NDArray[np.int32]) -> int:
    """List which of the `n` Gaussians of a tile touch `block`, in their order, and return how many do.

    ``masks[start]`` is the mask of the tile's first Gaussian. `queue` gets the positions 0 to n - 1 of the Gaussians in
    the tile; its length is at least n + 16.
    """
    n_queue = 0
    j = 0
    while j < n and start + j + 16 <= masks.shape[0]:  # The last load may include masks of the next tile.
        n_queue += put_selected(queue, n_queue, j, load_bit(masks, start + j, block) & (_lane_number() < f4(n - j)))
        j += 16
    while j < n:
        put(queue, n_queue, np.int32(j))
        n_queue += int((item(masks, start + j) >> block) & 1)
        j += 1
    return n_queue


@njit(**INNER)
def longest_list(tiles: NDArray[np.int32], tile_start: NDArray[np.int64]) -> int:
    """Return the largest number of Gaussians in one of `tiles`."""
    longest = 0
    for t in tiles:
        longest = max(longest, tile_start[t + 1] - tile_start[t])
    return longest


@njit(**INNER)
def prefetch_block(image: Float32, corner: int, width: int, n_channels: int) -> None:
    """Prefetch the 4x4 pixels whose upper left pixel has the index `corner` in flat `image` [H W n_channels]."""
    for y in range(4):
        row = (corner + y * np.int64(width)) * n_channels
        for at in range(0, 4 * n_channels + 15, 16):
            prefetch(image, row + at)


@njit(**INNER)
def whitened_offsets(px: Vec, py: Vec, geometry: Float32, at: int) -> tuple[Vec, Vec]:
    """Return (u, v) at pixel centres (px, py) relative to the tile, for the Gaussian at ``geometry[at:]``."""
    dx = px - item(geometry, at)
    dy = py - item(geometry, at + 1)
    b_dy = fma(dy, splat(item(geometry, at + 3)), splat(item(geometry, at + 6)))
    u = fma(dx, splat(item(geometry, at + 2)), b_dy)
    v = fma(dy, splat(item(geometry, at + 4)), splat(item(geometry, at + 7)))
    return u, v


@njit(**INNER)
def cover(u: Vec, v: Vec, opacity: float, t_now: Vec) -> tuple[Vec, Vec, Vec, Vec, Vec]:
    """Blend one Gaussian at 16 pixels. Both passes call this function, so that they agree on every threshold.

    Parameters
    ----------
    u, v : Vec
        Whitened offsets from the Gaussian.
    t_now : Vec
        Transmittance in front of the Gaussian; negative in finished lanes.

    Returns
    -------
    raw : Vec
        opacity 2^-(u^2 + v^2).
    alpha : Vec
        `raw` clamped to `ALPHA_MAX`, zero below `ALPHA_MIN`.
    weight : Vec
        alpha T, zero where `stop`.
    stop : mask
        Lanes that are finished or would fall below `T_MIN`.
    t_next : Vec
        Transmittance behind the Gaussian; negative in finished lanes.
    """
    zero = splat(f4(0.0))
    raw = exp2_negative(fma(u, u, v * v)) * opacity
    alpha = _clamp_to_alpha_max(raw)
    alpha = select(alpha >= _ALPHA_MIN, alpha, zero)
    t_next = fma(negative(alpha), t_now, t_now)
    stop = t_next < _T_MIN
    weight = select(stop, zero, alpha * t_now)
    return raw, alpha, weight, stop, select(stop, negative_abs(t_now), t_next)


@njit(**INNER)
def _touched_blocks(geometry: Float32, at: int, limit: float) -> int:
    """Return 16 bits, one for each block of the tile that has a point with u^2 + v^2 <= `limit`.

    A block is the rectangle of its pixel centres. The Gaussian is the one at ``geometry[at:]``. The nearest point is on
    one of the two sides of the block that face the centre; u^2 + v^2 is minimised on each side in closed form.
    """
    x = item(geometry, at)
    y = item(geometry, at + 1)
    a = item(geometry, at + 2)
    b = item(geometry, at + 3)
    c = item(geometry, at + 4)
    u0 = item(geometry, at + 6)
    v0 = item(geometry, at + 7)
    zero = splat(f4(0.0))
    left = _block_x() - x
    right = left + f4(3.0)
    top = _block_y() - y
    bottom = top + f4(3.0)
    side_x = minimum(maximum(zero, left), right)
    side_y = minimum(maximum(zero, top), bottom)
    # On x = side_x, (a x + b y + u0)^2 + (c y + v0)^2 has its minimum at y = -(b (a x + u0) + c v0) / (b^2 + c^2).
    inverse_square = f4(1.0) / (b * b + c * c)
    free_y = fma(side_x, splat(-a * b * inverse_square), splat(-(b * u0 + c * v0) * inverse_square))
    free_y = minimum(maximum(free_y, top), bottom)
    u = fma(side_x, splat(a), fma(free_y, splat(b), splat(u0)))
    v = fma(free_y, splat(c), splat(v0))
    on_column = fma(u, u, v * v)
    # On y = side_y, the minimum is at x = -(b y + u0) / a.
    inverse_a = f4(1.0) / a
    free_x = minimum(maximum(fma(side_y, splat(-b * inverse_a), splat(-u0 * inverse_a)), left), right)
    u = fma(free_x, splat(a), fma(side_y, splat(b), splat(u0)))
    v = fma(side_y, splat(c), splat(v0))
    on_row = fma(u, u, v * v)
    return all_bits(minimum(on_column, on_row) <= limit)


@njit(**INNER)
def _write_block(image: Float32, corner: int, width: int, n_x: int, n_y: int, n_channels: int, planes: Float32) -> None:
    """Copy `planes`, one vector for each channel, to n_x by n_y pixels of flat `image` [H W n_channels].

    `corner` is the index of the upper left pixel.
    """
    row_step = np.int64(width) * n_channels
    start = corner * n_channels
    if n_x == 4 and n_y == 4 and n_channels >= 4:
        for chunk in range(0, n_channels, 4):
            first = min(chunk, n_channels - 4)  # The last four channels overlap the previous four.
            at = first * 16
            store_pixels4(
                image, start + first, row_step, np.int64(n_channels),
                load(planes, at), load(planes, at + 16), load(planes, at + 32), load(planes, at + 48),
            )  # fmt: skip
        return
    for y in range(n_y):
        for x in range(n_x):
            for k in range(n_channels):
                put(image, start + k + y * row_step + x * n_channels, item(planes, k * 16 + 4 * y + x))


@njit(**JIT)
def blend_tiles(
    share: Share,
    tiles: NDArray[np.int32],
    width: int,
    height: int,
    tile_start: NDArray[np.int64],
    gaussians: NDArray[np.int32],
    pixels: NDArray[np.float64],
    roots: NDArray[np.float64],
    limits: Float32,
    opacities: Float32,
    colors: Float32,
    n_colors: int,
    n_channels: int,
    image: Float32,
    transmittance: Float32,
    masks: NDArray[np.uint16],
    geometry: Float32,
) -> None:
    """Render this thread's share of `tiles` into flat `image` [H W n_channels] and `transmittance` [H W].

    `pixels` [N 2], `roots` [N 3] and `colors` [N n_colors] are flat; n_colors is n_channels rounded up to a multiple of
    4. `masks` [M] and flat `geometry` [M GEOMETRY_SIZE], see `_write_geometry`, are filled too.
    """
    n_columns = (width + TILE - 1) // TILE
    n_tiles = tiles.shape[0]
    n_pairs = gaussians.shape[0]
    longest = longest_list(tiles, tile_start)
    queue = np.empty(longest + 16, np.int32)
    rows = np.empty(BATCH_SIZE, np.int64)
    weights = np.empty(BATCH_SIZE * 16, np.float32)
    sums = np.empty(n_colors * 16, np.float32)
    zero = splat(f4(0.0))
    first, last = take_range(share, n_tiles, TILES_PER_RANGE)
    while first < last:
        for t in tiles[first:last]:
            x0 = (t % n_columns) * TILE
            y0 = (t // n_columns) * TILE
            start = tile_start[t]
            n = tile_start[t + 1] - start
            placed = start * GEOMETRY_SIZE
            for j in range(n):
                ahead = np.int64(item(gaussians, min(start + j + PREFETCH_DISTANCE, n_pairs - 1)))
                _prefetch_ellipse(ahead, pixels, roots, opacities)
                prefetch_colors(ahead, colors, n_colors)
                g = np.int64(item(gaussians, start + j))
                at = placed + j * GEOMETRY_SIZE
                _write_geometry(g, x0, y0, pixels, roots, opacities, geometry, at)
                touched = _touched_blocks(geometry, at, f4(item(limits, g) + LIMIT_MARGIN))
                put(masks, start + j, np.uint16(touched))
            for block in range(16):
                block_x = 4 * (block % 4)
                block_y = 4 * (block // 4)
                if x0 + block_x >= width or y0 + block_y >= height:
                    bit = ~np.uint16(1 << block)
                    for j in range(n):
                        masks[start + j] &= bit
                    continue
                corner = np.int64(y0 + block_y) * width + x0 + block_x
                prefetch_block(image, corner, width, n_channels)
                n_queue = list_block_gaussians(masks, start, n, block, queue)
                px = lane_x() + f4(block_x)
                py = lane_y() + f4(block_y)
                for k in range(n_colors):
                    store(sums, k * 16, zero)
                t_now = splat(f4(1.0))
                i = 0
                alive = True
                while i < n_queue and alive:
                    n_batch = 0
                    while i < n_queue and n_batch < BATCH_SIZE:
                        j = int(item(queue, i))
                        i += 1
                        at = placed + j * GEOMETRY_SIZE
                        u, v = whitened_offsets(px, py, geometry, at)
                        _, _, weight, _, t_next = cover(u, v, item(geometry, at + 5), t_now)
                        store(weights, n_batch * 16, weight)
                        put(rows, n_batch, np.int64(item(gaussians, start + j)) * n_colors)
                        if any_of(t_next != t_now):
                            n_batch += 1
                        else:
                            masks[start + j] &= ~np.uint16(1 << block)
                        t_now = t_next
                        if not any_of(t_now > zero):
                            alive = False
                            break
                    for chunk in range(0, n_colors, 4):
                        sum_at = chunk * 16
                        sum0 = load(sums, sum_at)
                        sum1 = load(sums, sum_at + 16)
                        sum2 = load(sums, sum_at + 32)
                        sum3 = load(sums, sum_at + 48)
                        for k in range(n_batch):
                            weight = load(weights, k * 16)
                            color_at = item(rows, k) + chunk
                            sum0 = fma(weight, splat(item(colors, color_at)), sum0)
                            sum1 = fma(weight, splat(item(colors, color_at + 1)), sum1)
                            sum2 = fma(weight, splat(item(colors, color_at + 2)), sum2)
                            sum3 = fma(weight, splat(item(colors, color_at + 3)), sum3)
                        store(sums, sum_at, sum0)
                        store(sums, sum_at + 16, sum1)
                        store(sums, sum_at + 32, sum2)
                        store(sums, sum_at + 48, sum3)
                bit = ~np.uint16(1 << block)
                while i < n_queue:
                    masks[start + queue[i]] &= bit
                    i += 1
                n_x = min(4, width - x0 - block_x)
                n_y = min(4, height - y0 - block_y)
                store(weights, 0, maximum(t_now, negative(t_now)))
                _write_block(transmittance, corner, width, n_x, n_y, 1, weights)
                _write_block(image, corner, width, n_x, n_y, n_channels, sums)
        first, last = take_range(share, n_tiles, TILES_PER_RANGE)
