"""Photos that show the same, found by one vector per photo: no pair has to be compared for that.

Some features of all photos are the words of a vocabulary. A photo counts how often each word is among the nearest three
of its features; rare words weigh more (TF-IDF). The cosine of two photos' counts is their similarity.

References
----------
Sivic, Zisserman, "Video Google: a text retrieval approach to object matching in videos", ICCV 2003.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float32
from ..core.system import usable_cores

_WORDS = 16_384
_NEAREST = 3
"""Words that a feature counts for."""
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
        Draws the words.
    """
    every = np.concatenate(list(descriptors))
    words = every[np.random.default_rng(seed).permutation(len(every))[:_WORDS]]
    with ThreadPoolExecutor(max_workers=len(usable_cores())) as pool:
        counts = np.stack(list(pool.map(lambda features: _counts(features, words), descriptors)))
    photos_of_word = np.maximum((counts > 0).sum(axis=0), 1)
    vectors = (np.sqrt(counts) * np.log(len(counts) / photos_of_word)).astype(np.float32)
    vectors /= np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)
    found: set[tuple[int, int]] = set()
    for start in range(0, len(vectors), _ROWS):
        similarity = vectors[start : start + _ROWS] @ vectors.T
        rows = np.arange(len(similarity))
        similarity[rows, start + rows] = -1.0
        # Sorted in whole and stably: equal photos stay in the order of their names.
        nearest = np.argsort(-similarity, axis=1, kind="stable")[:, :partners]
        for i, row in enumerate(nearest, start):
            found.update((min(i, j), max(i, j)) for j in row.tolist() if similarity[i - start, j] > 0.0)
    return sorted(found)


def _counts(features: Float32, words: Float32) -> NDArray[np.uint16]:
    """Return how often each word [W] is among the nearest of a photo's features [K, 128]."""
    count = min(_NEAREST, len(words))
    if not len(features):
        return np.zeros(len(words), np.uint16)
    nearest = np.argpartition(-(features @ words.T), count - 1, axis=1)[:, :count]
    return np.bincount(nearest.ravel(), minlength=len(words)).astype(np.uint16)
