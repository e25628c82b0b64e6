"""How likely a picture shows one whole thing, neither a part nor several: a linear fit of the classifier's features.

``whole_things.txt`` has the bias and the 2,560 weights; ``python -m benchmarks.rooms.wholeness`` fits them.
"""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from ...core.arrays import Float32
from ...core.files import read_text

__all__ = ["WEIGHTS_FILE", "whole_odds"]


WEIGHTS_FILE = Path(__file__).with_name("whole_things.txt")


def whole_odds(features: Float32) -> Float32:
    """Return what the look of something adds to its log-odds of being one whole thing, [n].

    Parameters
    ----------
    features : array of shape [n, 2560], float32
        Of crops on white, and then of those with dimmed surroundings, by `EfficientNetLite2.pooled`.
    """
    bias, weights = _fit()
    return np.asarray(features @ weights + bias, np.float32)


@functools.cache
def _fit() -> tuple[np.float32, Float32]:
    lines = read_text(WEIGHTS_FILE, advice="Install the engine again.").splitlines()
    values = np.array([line for line in lines if not line.startswith("#")], np.float32)
    return values[0], values[1:]
