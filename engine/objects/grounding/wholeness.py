"""Features of the classifier in rooms: how likely they show one whole thing, and what they usually are.

``whole_things.txt`` has the bias and the 2,560 weights of a linear fit: one whole thing, neither a part nor several;
``python -m benchmarks.rooms.wholeness`` makes it. ``usual_features.txt`` has the mean of their square roots over what
may be objects; ``python -m benchmarks.rooms.taught_words --usual`` makes it.
"""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from ...core.arrays import Float32
from ...core.files import read_text

WEIGHTS_FILE = Path(__file__).with_name("whole_things.txt")
USUAL_FILE = Path(__file__).with_name("usual_features.txt")


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
def usual_features() -> Float32:
    """Return the mean square roots of the features of what may be objects, [2560], laid out as in `whole_odds`."""
    return _numbers(USUAL_FILE)


@functools.cache
def _fit() -> tuple[np.float32, Float32]:
    values = _numbers(WEIGHTS_FILE)
    return values[0], values[1:]


def _numbers(file: Path) -> Float32:
    lines = read_text(file, advice="Install the engine again.").splitlines()
    return np.array([line for line in lines if not line.startswith("#")], np.float32)
