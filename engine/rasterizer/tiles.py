"""Sorting by depth, and the list of the Gaussians that touch each tile, nearest first."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..core.arrays import Int32, Int64
from ..core.errors import NumericalError
from .jit import JIT
from .projection import GAUSSIANS_PER_RANGE, VISIBLE, Projected
from .simd import item, put
from .threads import Share, run_shared, take_range
from .tile_spans import MAX_STORED_ROWS, TILE, walk_tiles


@dataclass(frozen=True)
class TileLists:
    """The M pairs of a tile and a Gaussian that touches it, ordered by Gaussian and by tile.

    Attributes
    ----------
    pair_start : int64 [N + 1]
        Gaussian g has the pairs ``pair_start[g]`` to ``pair_start[g + 1]`` (exclusive); none if it was culled.
    tile_start : int64 [n_tiles + 1]
        Tile t has the entries ``tile_start[t]`` to ``tile_start[t + 1]`` (exclusive) of `gaussians`, nearest first.
    gaussians : int32 [M]
        Indices of Gaussians, tile after tile.
    list_positions : int32 [M]
        Position of each pair in `gaussians`.
    """

    pair_start: Int64
    tile_start: Int64
    gaussians: Int32
    list_positions: Int32

    @property
    def all_tiles(self) -> Int32:
        """Numbers of all tiles, which count row by row."""
        return np.arange(len(self.tile_start) - 1, dtype=np.int32)


@njit(**JIT)
def _sort_by_depth(state: NDArray[np.uint8], depth_bits: NDArray[np.uint32]) -> Int32:
    """Return the visible Gaussians sorted by depth, equal depths by index.

    A least-significant-digit radix sort with 3 passes of 11 bits. The bits of a positive float32, read as an integer,
    increase with its value.
    """
    keys = np.empty(state.shape[0], np.uint64)  # Upper half: depth. Lower half: index.
    starts = np.zeros((3, 2049), np.int64)
    n = 0
    for g in range(state.shape[0]):
        if state[g] == VISIBLE:
            bits = depth_bits[g]
            keys[n] = np.uint64(bits) << np.uint64(32) | np.uint64(g)
            n += 1
            for digit in range(3):
                starts[digit, ((bits >> np.uint32(11 * digit)) & np.uint32(2047)) + 1] += 1
    sorted_keys = np.empty(n, np.uint64)
    for digit in range(3):
        shift = np.uint64(32 + 11 * digit)
        for k in range(2048):
            starts[digit, k + 1] += starts[digit, k]
        for i in range(n):
            k = (keys[i] >> shift) & np.uint64(2047)
            sorted_keys[starts[digit, k]] = keys[i]
            starts[digit, k] += 1
        keys, sorted_keys = sorted_keys, keys
    order = np.empty(n, np.int32)
    for i in range(n):
        order[i] = np.int32(keys[i] & np.uint64(0xFFFFFFFF))
    return order


@njit(**JIT)
def _list_tiles(
    share: Share,
    pair_start: Int64,
    pixels: NDArray[np.float64],
    roots: NDArray[np.float64],
    limits: NDArray[np.float32],
    spans: NDArray[np.uint16],
    width: int,
    height: int,
    tiles: Int32,
) -> None:
    """Write the tile of each pair of this thread's share of the Gaussians, from the stored spans where they suffice."""
    n_columns = (width + TILE - 1) // TILE
    n = pair_start.shape[0] - 1
    first, last = take_range(share, n, GAUSSIANS_PER_RANGE)
    while first < last:
        for g in range(first, last):
            at = pair_start[g]
            if pair_start[g + 1] == at:
                continue
            if spans[g, 1] > MAX_STORED_ROWS:
                walk_tiles(
                    pixels[g, 0], pixels[g, 1], roots[g, 0], roots[g, 1], roots[g, 2], limits[g], width, height, spans,
                    g, True, at, tiles,
                )  # fmt: skip
                continue
            for k in range(np.int64(spans[g, 1])):
                row = (np.int64(spans[g, 0]) + k) * n_columns
                for column in range(np.int64(spans[g, 2 + 2 * k]), np.int64(spans[g, 3 + 2 * k])):
                    tiles[at] = row + column
                    at += 1
        first, last = take_range(share, n, GAUSSIANS_PER_RANGE)


@njit(**JIT)
def _group_by_tile(order: Int32, pair_start: Int64, tiles: Int32, n_tiles: int) -> tuple[Int64, Int32, Int32]:
    """Return `tile_start`, `gaussians` and `list_positions` of `TileLists`.

    A counting sort by tile that is stable with respect to the depth `order`.
    """
    n_pairs = tiles.shape[0]
    starts = np.zeros(n_tiles + 1, np.int64)
    for pair in range(n_pairs):
        t = int(item(tiles, pair)) + 1
        put(starts, t, item(starts, t) + 1)
    for t in range(n_tiles):
        starts[t + 1] += starts[t]
    next_positions = starts[:-1].copy()
    gaussians = np.empty(n_pairs, np.int32)
    list_positions = np.empty(n_pairs, np.int32)
    for i in range(order.shape[0]):
        g = int(item(order, i))
        for pair in range(item(pair_start, g), item(pair_start, g + 1)):
            t = int(item(tiles, pair))
            position = item(next_positions, t)
            put(next_positions, t, position + 1)
            put(gaussians, position, np.int32(g))
            put(list_positions, pair, np.int32(position))
    return starts, gaussians, list_positions


def make_tile_lists(projected: Projected, width: int, height: int, n_threads: int | None) -> TileLists:
    """Return the tile lists of an image of `width` x `height` pixels.

    Raises
    ------
    NumericalError
        If there are 2^31 pairs or more, because the Gaussians have grown over the whole image.
    """
    n = len(projected.state)
    pair_start = np.zeros(n + 1, np.int64)
    np.cumsum(projected.n_tiles, out=pair_start[1:])
    n_pairs = int(pair_start[-1])
    if n_pairs >= 2**31:
        raise NumericalError(
            f"`scales` are so large that {int((projected.n_tiles > 0).sum())} Gaussians cover {n_pairs} tiles of an "
            "image; resume from the last checkpoint with a lower learning rate for the scales."
        )
    tiles = np.empty(n_pairs, np.int32)

    sorting = threading.Lock()  # Acquired by the thread that sorts while the others list tiles.
    orders: list[Int32] = []

    def work(share: Share) -> None:
        if sorting.acquire(blocking=False):
            orders.append(_sort_by_depth(projected.state, projected.depths.view(np.uint32)))
        _list_tiles(
            share, pair_start, projected.pixels, projected.roots, projected.limits, projected.spans, width, height,
            tiles,
        )  # fmt: skip

    run_shared(work, n_threads)
    n_tiles = ((width + TILE - 1) // TILE) * ((height + TILE - 1) // TILE)
    return TileLists(pair_start, *_group_by_tile(orders[0], pair_start, tiles, n_tiles))
