"""Which 16x16 tiles an ellipse touches: exact, one span a row of tiles."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .jit import INNER

__all__ = ["LIMIT_MARGIN", "ROWS_KEPT", "TILE", "walk_tiles"]

TILE = 16

ROWS_KEPT = 4
"""Rows of tiles whose spans are kept of a Gaussian that touches no more."""

LIMIT_MARGIN = 0.01
"""Added to the limit of u^2 + v^2, so that rounding never leaves out a pixel that passes alpha >= 1/255."""


@njit(**INNER)
def _tile_rows(py: float, extent: float, height: int) -> tuple[int, int]:
    """Return the first row of tiles and the one after the last that reach into py - extent to py + extent."""
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
    """Return the first tile and the one after the last that the ellipse touches between y_low and y_high.

    For a given y the ellipse (a x + b y)^2 + (c y)^2 <= limit spans x = (-b y -+ sqrt(limit - (c y)^2)) / a; over a
    strip it reaches furthest right at its own rightmost point, held into the strip (it is convex), and likewise left.
    """
    y = min(max(y_right, y_low), y_high)
    right = px + slope * y + inverse_a * math.sqrt(max(limit - c2 * y * y, 0.0))
    y = min(max(-y_right, y_low), y_high)
    left = px + slope * y - inverse_a * math.sqrt(max(limit - c2 * y * y, 0.0))
    first = min(max((left - 0.5) / TILE, 0.0), np.float64(n_columns))
    last = min(max((right - 0.5) / TILE, -1.0), np.float64(n_columns - 1))
    # A tile's last pixel centre lies 15.5 into it: an ellipse that begins behind that does not touch the tile.
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

    Row `g` of `spans` gets the first row of tiles, their number, and of up to `ROWS_KEPT` of them the first column and
    the one after the last. With `write` (one function for both, so that counting and listing cannot disagree) the
    tiles' numbers go to ``tiles[at:]``, row by row.
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
        if row - first < ROWS_KEPT:
            spans[g, 2 + 2 * (row - first)] = left
            spans[g, 3 + 2 * (row - first)] = right
        if write:
            for column in range(left, right):
                tiles[at + n + column - left] = row * n_columns + column
        n += right - left
    return n
