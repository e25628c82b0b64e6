"""Few values that stand for many: codebooks of numbers, and palettes of vectors, for SOG files.

Our own, because Blender has no library for it and the engine's takes minutes for a palette of 65,536 vectors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float32

_BINS = 1 << 14
"""Steps of the range of the numbers, each of which counts as one value with a weight."""
_COARSE_BINS = 512
"""Steps of the range in which the density of the numbers is found, for the start."""
_NUMBERS = 256
"""Largest number of numbers in a codebook: a byte says which."""
_ROUNDS = 30
"""Rounds of Lloyd's algorithm; the error then falls by less than a thousandth in a round."""


def codebook(values: NDArray[np.floating]) -> tuple[Float32, NDArray[np.intp]]:
    """Return 256 numbers or fewer, ascending, and for each of `values`, of any shape, which of them is nearest.

    The numbers are those of Lloyd's algorithm, started where a density to the power of a third puts them, which is best
    for many numbers (Panter and Dite 1951).
    """
    flat = values.astype(np.float64).ravel()
    found = np.unique(flat)
    if len(found) > _NUMBERS:
        low, high = found[0], found[-1]
        places = np.minimum(((flat - low) * (_BINS / (high - low))).astype(np.intp), _BINS - 1)
        weights = np.bincount(places, minlength=_BINS)
        sums = np.bincount(places, flat, _BINS)
        filled = weights > 0
        weights, points = weights[filled], sums[filled] / weights[filled]
        found = _lloyd(points, weights.astype(np.float64), _NUMBERS)
    book = found.astype(np.float32)
    middles = (book[1:].astype(np.float64) + book[:-1]) / 2
    return book, np.searchsorted(middles, flat).reshape(values.shape)


def _lloyd(points: NDArray[np.float64], weights: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return `count` or fewer numbers for ascending `points` with `weights`."""
    sums, edges = np.histogram(points, _COARSE_BINS, weights=weights)
    density = np.append(0.0, np.cumsum(np.cbrt(sums)))
    book = np.interp((np.arange(count) + 0.5) / count * density[-1], density, edges)
    for _ in range(_ROUNDS):
        nearest = np.searchsorted((book[1:] + book[:-1]) / 2, points)
        total = np.bincount(nearest, weights, len(book))
        means = np.bincount(nearest, weights * points, len(book)) / np.where(total > 0, total, 1)
        book = np.where(total > 0, means, book)
    return book


def palette(vectors: Float32, count: int) -> tuple[Float32, NDArray[np.intp]]:
    """Return `count` vectors or fewer, [M, D], and for each of `vectors` [N, D] which of them stands for it.

    Cells of vectors are divided at their middle along the principal axis in which they differ most, those with the
    largest errors last, until there are `count`. That takes N log M steps where k-means takes N M.
    """
    labels = np.zeros(len(vectors), np.intp)
    if count < 2 or len(vectors) < 2:
        return vectors.mean(axis=0, keepdims=True), labels
    n_cells = 1
    centred = vectors - vectors.mean(axis=0)
    _, axes = np.linalg.eigh(np.cov(centred, rowvar=False).reshape(vectors.shape[1], -1))
    turned = centred @ axes.astype(np.float32)
    while n_cells < count:
        sizes, sums, errors = _statistics(turned, labels, n_cells)
        total = errors.sum(axis=1)
        cells = np.flatnonzero(total > 0)
        if not len(cells):
            break
        room = min(count - n_cells, max(1, len(cells)))
        chosen = cells[np.argsort(-total[cells], kind="stable")[:room]]
        axis = errors.argmax(axis=1)
        middle = sums[np.arange(n_cells), axis] / sizes
        new = np.full(n_cells, -1)
        new[chosen] = n_cells + np.arange(len(chosen))
        beyond = turned[np.arange(len(vectors)), axis[labels]] > middle[labels]
        labels = np.where(beyond & (new[labels] >= 0), new[labels], labels)
        n_cells += len(chosen)
    _, labels = np.unique(labels, return_inverse=True)
    entries = np.stack([np.bincount(labels, column) for column in vectors.T], axis=1) / np.bincount(labels)[:, None]
    return entries.astype(np.float32), labels.reshape(-1)


def _statistics(
    vectors: Float32, labels: NDArray[np.intp], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the sizes [M], at least 1, the sums [M, D] and the squared errors [M, D] of the cells."""
    sizes = np.maximum(np.bincount(labels, minlength=count), 1).astype(np.float64)
    sums: NDArray[np.float64] = np.stack([np.bincount(labels, column, count) for column in vectors.T], axis=1)
    squares: NDArray[np.float64] = np.stack(
        [np.bincount(labels, column * column, count) for column in vectors.T], axis=1
    )
    errors = squares - sums * sums / sizes[:, None]
    # Rounding leaves less than this of the squares of equal vectors.
    return sizes, sums, np.where(errors > 1e-6 * squares, errors, 0.0)
