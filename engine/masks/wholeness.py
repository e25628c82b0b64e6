"""How likely a segment shows one whole thing, neither a part nor several: a linear fit of SAM's features in it.

``whole_segments.txt`` has the bias and the 256 weights; ``python -m benchmarks.rooms.whole_segments`` fits them.
"""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..files import read_text
from .sam import INPUT_SIDE, Embedding
from .settings import SAM_MODELS

__all__ = ["WEIGHTS_FILE", "features_of_segments", "whole_odds"]

WEIGHTS_FILE = Path(__file__).with_name("whole_segments.txt")


def features_of_segments(embedding: Embedding, labels: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the mean of SAM's features over each segment of a photo, [n, 256]; 0 for an id that no pixel has.

    Parameters
    ----------
    embedding : Embedding
    labels : array of shape [h, w], int32
        Segment ids 1 to n of the same photo, at any size; 0 for unlabelled pixels.
    """
    channels, side = embedding.features.shape[1:3]
    rows, columns = (
        ((np.arange(pixels) + 0.5) * (length * embedding.scale * side / (pixels * INPUT_SIDE))).astype(np.int64)
        for pixels, length in zip(labels.shape, (embedding.height, embedding.width), strict=True)
    )
    n_cells, n_labels = side * side, int(labels.max(initial=0)) + 1
    cells = labels.astype(np.int64) * n_cells + rows[:, None] * side + columns
    counts = np.bincount(cells.ravel(), minlength=n_labels * n_cells).reshape(n_labels, n_cells)[1:]
    total = counts.astype(np.float32) @ embedding.features.reshape(channels, n_cells).T
    return np.asarray(total / np.maximum(counts.sum(axis=1, keepdims=True), 1), np.float32)


def whole_odds(embedding: Embedding, labels: NDArray[np.int32], model: str) -> NDArray[np.float32]:
    """Return what the look of each segment adds to the log-odds of showing one whole thing, [n].

    Parameters
    ----------
    embedding, labels
        See `features_of_segments`.
    model : str
        Name of the SAM model, one of `SAM_MODELS`. The weights are those of the first; the features of any other one
        tell nothing, so that all log-odds are 0.
    """
    if model != SAM_MODELS[0]:
        return np.zeros(int(labels.max(initial=0)), np.float32)
    bias, weights = _fit()
    return np.asarray(features_of_segments(embedding, labels) @ weights + bias, np.float32)


@functools.cache
def _fit() -> tuple[np.float32, NDArray[np.float32]]:
    lines = read_text(WEIGHTS_FILE, advice="Install the engine again.").splitlines()
    values = np.array([line for line in lines if not line.startswith("#")], np.float32)
    return values[0], values[1:]
