"""Groups of like features, and colours to tell them apart."""

from __future__ import annotations

import colorsys

import numpy as np
from numpy.typing import NDArray

from .scene import normalized

__all__ = ["cluster_colors", "find_clusters", "principal_colors"]

Float32 = NDArray[np.float32]

_SAMPLES = 3000
_DENSITY_COSINE = 0.85


def find_clusters(
    features: NDArray[np.floating],
    weights: NDArray[np.floating],
    *,
    cosine: float = 0.7,
    max_clusters: int = 64,
    seed: int = 0,
) -> Float32:
    """Return the directions around which features gather, the most crowded first.

    Of a weighted sample, the feature with most neighbours (cosine above 0.85) becomes a centre and takes all within
    `cosine` with it, until a group holds less than 0.5 % of the sample.

    Parameters
    ----------
    features : array of shape [N, D], float
    weights : array of shape [N], float
        Importance of each, not negative: opacity.
    cosine : float
        Radius of a group.
    max_clusters : int
    seed : int
        Of the sample.

    Returns
    -------
    array of shape [K, D], float32
        Unit vectors; K is 0 when all weights or features are zero.
    """
    unit = normalized(features)
    chance = np.where(np.abs(unit).sum(axis=1) > 0, np.clip(weights, 0, None), 0).astype(np.float64)
    if chance.sum() == 0:
        return np.zeros((0, unit.shape[1]), np.float32)
    size = min(_SAMPLES, int((chance > 0).sum()))
    picked = np.random.default_rng(seed).choice(len(unit), size=size, replace=False, p=chance / chance.sum())
    sample = unit[picked]
    likeness = sample @ sample.T
    near = likeness >= max(_DENSITY_COSINE, cosine)
    free = np.ones(size, bool)
    centers: list[Float32] = []
    while len(centers) < max_clusters and free.any():
        crowd = (near & free[None, :]).sum(axis=1) * free
        leader = int(crowd.argmax())
        if crowd[leader] < max(1, 0.005 * size):
            break
        center = normalized(sample[near[leader] & free].mean(axis=0))
        centers.append(center)
        free &= (sample @ center < cosine) & (likeness[leader] < cosine)
    return np.stack(centers) if centers else np.zeros((0, unit.shape[1]), np.float32)


def cluster_colors(count: int) -> Float32:
    """Return `count` colours that are easy to tell apart, shape [count, 3], float32, sRGB in [0, 1]."""
    golden = 0.618033988749895
    colors = [
        colorsys.hsv_to_rgb((0.03 + golden * i) % 1.0, (0.72, 0.5, 0.85)[i % 3], (0.92, 0.98, 0.72)[i % 3])
        for i in range(count)
    ]
    return np.asarray(colors, np.float32).reshape(count, 3)


def principal_colors(features: NDArray[np.floating], weights: NDArray[np.floating]) -> tuple[Float32, Float32, Float32]:
    """Return what turns normalised features into colours that mean the same in every view.

    Parameters
    ----------
    features : array of shape [N, D], float
        Of the Gaussians.
    weights : array of shape [N], float
        Importance of each: opacity.

    Returns
    -------
    basis : array of shape [D, 3], float32
        The three principal axes of the normalised features.
    low, high : array of shape [3], float32
        Values that become black and full colour: the 1st and 99th percentile along each axis.
    """
    unit = normalized(features).astype(np.float64)
    share = weights.astype(np.float64) / max(float(weights.sum()), 1e-12)
    mean = share @ unit
    covariance = ((unit - mean) * share[:, None]).T @ (unit - mean)
    axes = np.linalg.eigh(covariance)[1][:, ::-1][:, :3]
    # eigh leaves the signs open; fixing them keeps colours the same from run to run.
    axes *= np.where(axes[np.abs(axes).argmax(axis=0), np.arange(axes.shape[1])] < 0, -1.0, 1.0)
    low, high = np.percentile(unit @ axes, [1, 99], axis=0)
    high = np.maximum(high, low + 1e-6)
    return axes.astype(np.float32), low.astype(np.float32), high.astype(np.float32)
