"""The 16x16 tiles that an ellipse touches, computed exactly as one span of tiles in each row of tiles."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .jit import INNER

TILE = 16
"""Side of a tile in pixels. A tile consists of 16 blocks of 4x4 pixels, one block for each lane of a vector."""

MAX_STORED_ROWS = 4
"""Largest number of rows of tiles whose spans are stored. The spans of a Gaussian in more rows are computed again."""

LIMIT_MARGIN = 0.01
"""Added to the limit of u^2 + v^2, so that rounding never excludes a pixel where alpha is at least 1/255."""


@njit(**INNER)
def _tile_rows(py: float, extent: float, height: int) -> tuple[int, int]:
    """Return the first and the end of the rows of tiles that overlap the interval py - extent to py + extent."""
    n_rows = (height + TILE - 1) // TILE
    first = min(max((py - extent - 0.5) / TILE, 0.0), np.float64(n_rows))
    last = min(max((py + extent - 0.5) / TILE, -1.0), np.float64(n_rows - 1))
    return int(math.floor(first)), int(math.floor(last)) + 1


@njit(**INNER)
def _tile_span(
    y_low: float,
    y_high: float,
    y_right: float,
    px: float,
    slope: float,
    inverse_a: float,
    c2: float,
    limit: float,
    n_columns: int,
) -> tuple[int, int]:
    """Return the first and the end of the tiles that the ellipse touches between y_low and y_high.

    For a given y the ellipse (a x + b y)^2 + (c y)^2 <= limit spans x = (-b y -+ sqrt(limit - (c y)^2)) / a. The
    ellipse is convex, so its rightmost point in a strip is at the y of its overall rightmost point, clamped to the
    strip; the same holds on the left.
    """
    y = min(max(y_right, y_low), y_high)
    right = px + slope * y + inverse_a * math.sqrt(max(limit - c2 * y * y, 0.0))
    y = min(max(-y_right, y_low), y_high)
    left = px + slope * y - inverse_a * math.sqrt(max(limit - c2 * y * y, 0.0))
    first = min(max((left - 0.5) / TILE, 0.0), np.float64(n_columns))
    last = min(max((right - 0.5) / TILE, -1.0), np.float64(n_columns - 1))
    # The last pixel centre of a tile is 15.5 pixels from its left side. An ellipse that begins to the right of it does
    # not touch the tile.
    first_tile = int(math.floor(first))
    if left - 0.5 - first_tile * TILE > TILE - 1:
        first_tile += 1
    return first_tile, max(first_tile, int(math.floor(last)) + 1)


@njit(**INNER)
def walk_tiles(
    px: float,
    py: float,
    a: float,
    b: float,
    c: float,
    limit: float,
    width: int,
    height: int,
    spans: NDArray[np.uint16],
    g: int,
    write: bool,
    at: int,
    tiles: NDArray[np.int32],
) -> int:
    """Return how many tiles the ellipse u^2 + v^2 <= `limit` around (px, py) touches.

    Row `g` of `spans` is filled: the first row of tiles, the number of rows, and for up to `MAX_STORED_ROWS` rows the
    first column and the end column. With `write`, the numbers of the tiles are also written to ``tiles[at:]``, row by
    row. One function does both, so that counting and listing cannot disagree.
    """
    limit = max(limit, 0.0) + LIMIT_MARGIN
    n_columns = (width + TILE - 1) // TILE
    root = math.sqrt(limit)
    extent = root / c
    inverse_a = 1.0 / a
    slope = -b * inverse_a
    y_right = -b * extent / math.sqrt(b * b + c * c)
    c2 = c * c
    first, last = _tile_rows(py, extent, height)
    spans[g, 0] = first
    spans[g, 1] = max(last - first, 0)
    n = 0
    for row in range(first, last):
        left = 0
        right = 0
        y_low = row * TILE + 0.5 - py
        y_high = min(row * TILE + TILE, height) - 0.5 - py
        if y_high >= -extent and y_low <= extent:
            left, right = _tile_span(
                max(y_low, -extent), min(y_high, extent), y_right, px, slope, inverse_a, c2, limit, n_columns
            )
        if row - first < MAX_STORED_ROWS:
            spans[g, 2 + 2 * (row - first)] = left
            spans[g, 3 + 2 * (row - first)] = right
        if write:
            for column in range(left, right):
                tiles[at + n + column - left] = row * n_columns + column
        n += right - left
    return n
