"""Words that pictures of free packages taught: how much a crop looks like each of them.

``picture_features.npy`` has a direction for each word of ``engine/core/words/picture_words.txt``: the mean direction of
its pictures from the mean of all pictures, of the square roots of the classifier's features. Crops on white come first,
and then those with dimmed surroundings. ``scripts/picture_words.py`` makes both files.
"""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from ...core.arrays import Float32, normalized
from ...core.files import ArraySpec, read_array
from ...core.words import picture_words
from .efficientnet import N_FEATURES
from .wholeness import usual_features

FEATURES_FILE = Path(__file__).with_name("picture_features.npy")

_STEEPNESS = 20.0  # chosen on pictures
"""Logit of a word for a cosine of 1 with its pictures, less that for 0."""
_BIAS = 4.0  # chosen on pictures
"""Logit of a word for what has nothing in common with its pictures, beside those of the classes."""


def picture_logits(features: Float32) -> Float32:
    """Return the logit of each word, beside those of the classes, for each crop: ``[..., c, W]``.

    Parameters
    ----------
    features : array of shape [..., c, 1280], float32
        Of crops on white alone (c is 1), or of those with dimmed surroundings as well (2).
    """
    n_crops = features.shape[-2]
    usual = usual_features().reshape(2, N_FEATURES)[:n_crops]
    directions = normalized(np.sqrt(np.maximum(features, 0)) - usual)
    cosines = np.einsum("...cd,wcd->...cw", directions, _directions()[:, :n_crops], optimize=True)
    return np.asarray(_STEEPNESS * cosines + _BIAS, np.float32)


@functools.cache
def _directions() -> Float32:
    """Return the directions of all words, [W, 2, 1280]."""
    spec = ArraySpec("int8", (len(picture_words().classes), 2 * N_FEATURES))
    stored = read_array(FEATURES_FILE, spec, advice="Install the engine again.")
    return normalized(stored.astype(np.float32).reshape(-1, 2, N_FEATURES))
