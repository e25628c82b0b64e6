"""Agreement of segmentation features with SAM's segments in photos that were not trained on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from engine.core.arrays import Float32
from engine.masks import mask_iou
from engine.masks.settings import INSTANCE_COSINE
from engine.quality.evaluation.trained_scene import innermost_pixel
from engine.rasterizer import rasterize
from engine.scene import Gaussians
from engine.training import TrainingView, initial_features

_MIN_ALPHA = 0.5
"""Alpha below which a pixel is not selected: too little of it is covered by Gaussians."""


@dataclass(frozen=True)
class SegmentAgreement:
    """Agreement of rendered features with segments.

    Attributes
    ----------
    mean_iou : float
        Mean over all segments of all photos, 0 to 1; NaN without a segment.
    n_segments : int
    photos : dict of str to float
        Mean over the segments of each photo that has any.
    """

    mean_iou: float
    n_segments: int
    photos: dict[str, float]


def segment_agreement(
    gaussians: Gaussians,
    views: Sequence[TrainingView],
    *,
    threshold: float = INSTANCE_COSINE,
    min_pixels: int = 100,
) -> SegmentAgreement:
    """Return the mean IoU between segments and the pixels that one click inside them selects.

    The click is the pixel of the segment farthest from its border. It selects the pixels whose rendered feature has a
    cosine of at least `threshold` with its own (Dahaghin et al. 2024) and whose alpha is at least 0.5.

    Parameters
    ----------
    gaussians : Gaussians
        With features.
    views : sequence of TrainingView
        Held-out photos with labels; those without labels are skipped.
    threshold : float
        Cosine, -1 to 1.
    min_pixels : int
        Smaller segments are skipped.
    """
    if gaussians.features is None:
        raise ValueError("these Gaussians have no features")
    photos, every = {}, []
    for view in views:
        if view.labels is None:
            continue
        features, cover = _render_features(gaussians, view)
        found = _segment_ious(features, cover, view.labels.array(), threshold, min_pixels)
        if found:
            photos[view.photo] = float(np.mean(found))
            every += found
    return SegmentAgreement(float(np.mean(every)) if every else float("nan"), len(every), photos)


def untrained_features(gaussians: Gaussians, *, seed: int = 0) -> Gaussians:
    """Return the same Gaussians with random features, the baseline of `segment_agreement`."""
    dim = 16 if gaussians.features is None else gaussians.features.shape[1]
    features = initial_features(len(gaussians), dim, np.random.default_rng(seed), "unit")
    return replace(gaussians, features=features)


def _render_features(gaussians: Gaussians, view: TrainingView) -> tuple[Float32, Float32]:
    """Return rendered features of unit length [h, w, F] and alpha [h, w]."""
    assert gaussians.features is not None
    with torch.no_grad():
        raster = rasterize(
            torch.from_numpy(gaussians.means),
            torch.from_numpy(gaussians.quats),
            torch.from_numpy(gaussians.scales),
            torch.from_numpy(gaussians.opacities),
            camera=view.pinhole,
            channels=torch.from_numpy(gaussians.features),
        )
        features = torch.nn.functional.normalize(raster.image, dim=2, eps=1e-9)
        return features.numpy(), 1.0 - raster.transmittance.numpy()


def _segment_ious(
    features: Float32, cover: Float32, labels: NDArray[np.int32], threshold: float, min_pixels: int
) -> list[float]:
    ids, counts = np.unique(labels, return_counts=True)
    found = []
    for segment_id in ids[(ids > 0) & (counts >= min_pixels)]:
        segment = labels == segment_id
        y, x = innermost_pixel(segment)
        selected = (features @ features[y, x] >= threshold) & (cover >= _MIN_ALPHA)
        found.append(mask_iou(selected, segment))
    return found
