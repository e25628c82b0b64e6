"""Photos that look like each other, found by one descriptor per photo: no pair has to be compared for that.

The largest features of a photo are assigned to the words of a codebook, which is learnt from the photos themselves. The
descriptor of a photo is the sum of the differences between its features and their words (VLAD), each word on its own
scale, so that a repeated pattern counts once.

References
----------
Jegou, Douze, Schmid, Perez, "Aggregating local descriptors into a compact image representation", CVPR 2010.
Arandjelovic, Zisserman, "All about VLAD", CVPR 2013 (each word normalised on its own).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float32

__all__ = ["similar_pairs"]

_WORDS = 64
_SAMPLE = 20_000
"""Features that the codebook is learnt from."""
_ROUNDS = 12
"""Rounds of k-means."""
_ROWS = 512
"""Photos whose similarities are held at a time."""


def similar_pairs(descriptors: Sequence[Float32], *, partners: int, seed: int) -> list[tuple[int, int]]:
    """Return the sorted pairs (i, j), i < j, in which one photo is among the `partners` most similar of the other.

    Parameters
    ----------
    descriptors : sequence of arrays of shape [K, 128], float32
        Features of each photo, of length 1. A photo without any is similar to none.
    partners : int
        Similar photos of a photo at most.
    seed : int
        Draws the features that the codebook is learnt from.
    """
    words = _codebook(descriptors, seed)
    photos = np.stack([_descriptor(features, words) for features in descriptors])
    found: set[tuple[int, int]] = set()
    for start in range(0, len(photos), _ROWS):
        similarity = photos[start : start + _ROWS] @ photos.T
        own = np.arange(len(similarity))
        similarity[own, start + own] = -np.inf
        # Sorted in whole and stably: equal photos stay in the order of their names.
        nearest = np.argsort(-similarity, axis=1, kind="stable")[:, :partners]
        for i, row in enumerate(nearest, start):
            found.update((min(i, j), max(i, j)) for j in row.tolist() if similarity[i - start, j] > 0.0)
    return sorted(found)


def _codebook(descriptors: Sequence[Float32], seed: int) -> Float32:
    """Return the words [W, 128] that k-means finds among the features; fewer where there are fewer features."""
    rng = np.random.default_rng(seed)
    every = max(1, -(-_SAMPLE // max(1, len(descriptors))))
    sample = np.concatenate([features[rng.permutation(len(features))[:every]] for features in descriptors])
    words = sample[rng.permutation(len(sample))[:_WORDS]]
    for _ in range(_ROUNDS):
        nearest = _nearest(sample, words)
        sums = np.zeros_like(words)
        np.add.at(sums, nearest, sample)
        counts = np.bincount(nearest, minlength=len(words))
        # A word that is nearest to no feature stays where it is.
        words = np.where(counts[:, None] > 0, sums / np.maximum(counts, 1)[:, None], words).astype(np.float32)
    return words


def _nearest(features: Float32, words: Float32) -> NDArray[np.intp]:
    """Return the row of the nearest word for each feature [K]."""
    # |f - w|^2 = |f|^2 - 2 f.w + |w|^2, and |f| is the same for all words.
    return (features @ words.T - 0.5 * (words**2).sum(axis=1)).argmax(axis=1)


def _descriptor(features: Float32, words: Float32) -> Float32:
    """Return the descriptor of a photo, [W 128], of length 1; zeros for a photo without features."""
    sums = np.zeros_like(words)
    if len(features):
        nearest = _nearest(features, words)
        np.add.at(sums, nearest, features - words[nearest])
    for axis in (1, None):
        sums /= np.maximum(np.linalg.norm(sums, axis=axis, keepdims=True), 1e-9)
    return sums.ravel()
