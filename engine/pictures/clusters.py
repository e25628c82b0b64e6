"""Clusters of similar features, and colours for features and clusters."""

from __future__ import annotations

import colorsys

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float32, normalized
from ..masks.settings import INSTANCE_COSINE

_SAMPLE_SIZE = 3000
"""Features that are clustered, drawn by weight."""

_NEIGHBOUR_COSINE = 0.85
"""Smallest cosine between two neighbouring features, used for the density."""

_MAX_CLUSTERS = 64

_MIN_CLUSTER_SHARE = 0.005
"""Smallest cluster as a share of the sample."""


def find_clusters(features: NDArray[np.floating], weights: NDArray[np.floating]) -> Float32:
    """Return the centres of at most 64 clusters of features, in descending order of density.

    In a weighted sample, the feature with the most neighbours (cosine of at least 0.85) becomes the centre of a
    cluster, and all features within `INSTANCE_COSINE` of it are removed. This ends when a cluster has less than 0.5 %
    of the sample.

    Parameters
    ----------
    features : array of shape [N, D], float
    weights : array of shape [N], float
        Non-negative weight of each feature, e.g. the opacity.

    Returns
    -------
    array of shape [K, D], float32
        Unit vectors; K is 0 if all weights or features are zero.
    """
    unit = normalized(features)
    probability = np.where(np.abs(unit).sum(axis=1) > 0, np.clip(weights, 0, None), 0).astype(np.float64)
    if probability.sum() == 0:
        return np.zeros((0, unit.shape[1]), np.float32)
    size = min(_SAMPLE_SIZE, int((probability > 0).sum()))
    rows = np.random.default_rng(0).choice(len(unit), size=size, replace=False, p=probability / probability.sum())
    sample = unit[rows]
    cosines = sample @ sample.T
    near = cosines >= max(_NEIGHBOUR_COSINE, INSTANCE_COSINE)
    free = np.ones(size, bool)
    centers: list[Float32] = []
    while len(centers) < _MAX_CLUSTERS and free.any():
        density = (near & free[None, :]).sum(axis=1) * free
        densest = int(density.argmax())
        if density[densest] < max(1, _MIN_CLUSTER_SHARE * size):
            break
        center = normalized(sample[near[densest] & free].mean(axis=0))
        centers.append(center)
        free &= (sample @ center < INSTANCE_COSINE) & (cosines[densest] < INSTANCE_COSINE)
    return np.stack(centers) if centers else np.zeros((0, unit.shape[1]), np.float32)


def cluster_colors(count: int) -> Float32:
    """Return `count` distinct colours, shape [count, 3], float32, sRGB in [0, 1]."""
    golden = 0.618033988749895
    colors = [
        colorsys.hsv_to_rgb((0.03 + golden * i) % 1.0, (0.72, 0.5, 0.85)[i % 3], (0.92, 0.98, 0.72)[i % 3])
        for i in range(count)
    ]
    return np.asarray(colors, np.float32).reshape(count, 3)


def principal_colors(features: NDArray[np.floating], weights: NDArray[np.floating]) -> tuple[Float32, Float32, Float32]:
    """Return the projection of normalised features to colours that are consistent across views.

    Parameters
    ----------
    features : array of shape [N, D], float
        Features of the Gaussians.
    weights : array of shape [N], float
        Weight of each Gaussian, e.g. its opacity.

    Returns
    -------
    basis : array of shape [D, 3], float32
        First three principal axes of the normalised features.
    low, high : array of shape [3], float32
        Values that become 0 and full intensity: the 1st and 99th percentile along each axis.
    """
    unit = normalized(features).astype(np.float64)
    share = weights.astype(np.float64) / max(float(weights.sum()), 1e-12)
    mean = share @ unit
    covariance = ((unit - mean) * share[:, None]).T @ (unit - mean)
    axes = np.linalg.eigh(covariance)[1][:, ::-1][:, :3]
    # eigh does not determine the signs. Fixing them keeps the colours the same in every run.
    axes *= np.where(axes[np.abs(axes).argmax(axis=0), np.arange(axes.shape[1])] < 0, -1.0, 1.0)
    low, high = np.percentile(unit @ axes, [1, 99], axis=0)
    high = np.maximum(high, low + 1e-6)
    return axes.astype(np.float32), low.astype(np.float32), high.astype(np.float32)
