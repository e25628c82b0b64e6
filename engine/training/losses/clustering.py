"""L_CC, contrastive clustering of the blended features over segments: on the processor, and on a card."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...core.label_runs import LabelRuns
from ...rasterizer.gpu import Frame, Submissions, with_room
from ...scene import PinholeCamera
from .samples import Sample

_SAMPLES = 64
"""Samples of a workgroup of clustering_losses.wgsl."""


@dataclass(frozen=True)
class LabelledPixels:
    """The P pixels of one picture that lie in segments of enough pixels, row by row, as R runs within one segment.

    Attributes
    ----------
    ends : array of shape [R], int32
        Labelled pixels up to the end of each run.
    offset : array of shape [R], int32
        Pixels without label before the end of each run.
    cluster : array of shape [R], int32
        Segment of each run, 0 to n_p - 1.
    counts : tensor of shape [n_p], float32
        Number of pixels of each segment.
    """

    ends: NDArray[np.int32]
    offset: NDArray[np.int32]
    cluster: NDArray[np.int32]
    counts: torch.Tensor

    def __len__(self) -> int:
        return int(self.ends[-1])

    def at(self, numbers: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Return the pixel, counted row by row in the picture, and the segment of each number, 0 to P - 1."""
        run = np.searchsorted(self.ends, numbers, side="right")
        return self.offset[run] + numbers.astype(np.int32), self.cluster[run]


def labelled_pixels(labels: NDArray[np.int32], *, min_pixels: int) -> LabelledPixels | None:
    """Return the pixels of `labels` [h, w] in segments of more than `min_pixels`; None for fewer than two segments.

    A contrastive loss on one segment is constant.
    """
    runs = LabelRuns.of(np.maximum(labels, 0))
    lengths = np.diff(runs.ends, prepend=0)
    counts = np.bincount(runs.labels, weights=lengths).astype(np.int64)
    kept = counts > min_pixels
    kept[0] = False
    if kept.sum() < 2:
        return None
    is_kept = kept[runs.labels]
    ends = np.cumsum(lengths[is_kept])
    return LabelledPixels(
        ends.astype(np.int32),
        (runs.ends[is_kept] - ends).astype(np.int32),
        (np.cumsum(kept) - 1)[runs.labels[is_kept]].astype(np.int32),
        torch.from_numpy(counts[kept].astype(np.float32)),
    )


def clustering_loss(
    features: torch.Tensor,
    labelled: LabelledPixels,
    *,
    n_samples: int = 0,
    generator: torch.Generator | None = None,
) -> torch.Tensor:
    """Return L_CC of one picture: a sum over its labelled pixels, divided by the number of segments.

    Parameters
    ----------
    features : tensor of shape [h, w, F]
        Rendered features, blended like colour, without background.
    n_samples : int
        Random pixels to evaluate on, 0 for all. The value is then an estimate: the sum over the sample times P / S.
    generator : torch.Generator, optional
        Draws the sample.

    Returns
    -------
    tensor, scalar

    Notes
    -----
    With f normalised per pixel, fbar_i the mean of segment i (not normalised again) and n_i its pixels::

        phi_i = clip(10 sum_j |f_ij - fbar_i| / (n_i ln(n_i + 100)), 0.1, 1), no gradient
        l_ij  = -log( exp(f_ij . fbar_i / phi_i) / sum_k exp(f_ij . fbar_k / phi_k) )
        L_CC  = 1/n_p sum_i sum_j l_ij

    With a sample, phi is estimated from the sampled distances and the true n_i.

    References
    ----------
    Dahaghin et al. 2024, the contrastive clustering loss; Silva et al. 2024 (arXiv 2404.12784).
    """
    drawn, segments, weight = drawn_pixels(labelled, n_samples, generator)
    index, cluster = torch.from_numpy(drawn).long(), torch.from_numpy(segments).long()
    f = features.reshape(-1, features.shape[-1])[index]
    f = f / (f.norm(dim=1, keepdim=True) + 1e-9)
    n_clusters = len(labelled.counts)
    one_hot_sum = torch.zeros(n_clusters, f.shape[1], dtype=f.dtype).index_add(0, cluster, f)
    sampled = torch.bincount(cluster, minlength=n_clusters)
    means = one_hot_sum / sampled.clamp_min(1).to(f.dtype)[:, None]
    phi = _temperatures(f.detach(), means.detach(), cluster, sampled, labelled.counts.to(f.dtype))
    # A segment without a sampled pixel has no mean.
    logits = (f @ means.T / (phi + 1e-6)).masked_fill(sampled == 0, -torch.inf)
    loss = torch.logsumexp(logits, dim=1) - logits.gather(1, cluster[:, None])[:, 0]
    return loss.sum() * (weight / n_clusters)


def drawn_pixels(
    labelled: LabelledPixels, n_samples: int, generator: torch.Generator | None
) -> tuple[NDArray[np.int32], NDArray[np.int32], float]:
    """Return pixels and segments of the labelled pixels that are drawn, all of them for 0, and the weight of each."""
    if not 0 < n_samples < len(labelled):
        return *labelled.at(np.arange(len(labelled))), 1.0
    numbers = torch.randint(len(labelled), (n_samples,), generator=generator).numpy()
    return *labelled.at(numbers), len(labelled) / n_samples


def _temperatures(
    f: torch.Tensor, means: torch.Tensor, cluster: torch.Tensor, sampled: torch.Tensor, counts: torch.Tensor
) -> torch.Tensor:
    distance = (f - means[cluster]).norm(dim=1)
    mean_distance = torch.zeros_like(counts).index_add(0, cluster, distance) / sampled.clamp_min(1).to(f.dtype)
    return (10.0 * mean_distance / torch.log(counts + 100.0)).clamp(0.1, 1.0)


@dataclass(frozen=True)
class ClusteringSample(Sample):
    """Labelled pixels of one picture that L_CC is evaluated on, drawn by the caller.

    Attributes
    ----------
    pixels : int array of shape [S]
        Numbers of the pixels, row by row. A pixel that was drawn several times counts so many times.
    clusters : int array of shape [S]
        Segment of each pixel, 0 to n_p - 1, the same for each time that the pixel was drawn.
    counts : float32 array of shape [n_p]
        Number of pixels of each segment in the whole picture.
    weight : float
        Factor of L_CC, which is the sum over the sample divided by n_p; with the labelled pixels per sampled one.

    Raises
    ------
    ValueError
        If the shapes do not match, nothing was drawn, or a segment does not exist.
    """

    pixels: NDArray[np.integer[Any]]
    clusters: NDArray[np.integer[Any]]
    counts: NDArray[np.float32]
    weight: float
    before_backward = True
    needs_features = True

    def __post_init__(self) -> None:
        if not len(self.pixels) or self.pixels.shape != self.clusters.shape or self.pixels.ndim != 1:
            raise ValueError(f"a sample has one segment for each pixel, got {self.pixels.shape}, {self.clusters.shape}")
        if self.clusters.min() < 0 or self.clusters.max() >= len(self.counts) or self.pixels.min() < 0:
            raise ValueError(f"pixels of a sample are at least 0, and their segments 0 to {len(self.counts) - 1}")

    def sort(self) -> None:
        _ = self.packed

    def check(self, camera: PinholeCamera, n_gaussians: int) -> None:
        if self.pixels.max() >= camera.width * camera.height:
            raise ValueError(f"the plan samples pixels outside of {camera.width} x {camera.height}")

    def loss_on(self, frame: Frame) -> ClusteringLoss:
        return ClusteringLoss(frame)

    @functools.cached_property
    def packed(self) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
        """Rows ``samples`` [U, 4] and ``segments`` [n_p, 4] of clustering.wgsl."""
        keys = np.sort((self.clusters.astype(np.uint64) << np.uint64(32)) | self.pixels.astype(np.uint64))
        first = np.flatnonzero(np.diff(keys, prepend=~keys[:1]))
        samples = np.zeros((len(first), 4), np.uint32)
        samples[:, 0] = keys[first] & np.uint64(0xFFFFFFFF)
        samples[:, 1] = keys[first] >> np.uint64(32)
        samples[:, 2] = np.diff(first, append=len(keys))
        segments = np.zeros((len(self.counts), 4), np.uint32)
        edges = np.searchsorted(samples[:, 1], np.arange(len(self.counts) + 1))
        segments[:, 0], segments[:, 1] = edges[:-1], edges[1:]
        segments[:, 2] = np.bincount(self.clusters, minlength=len(self.counts))
        segments[:, 3] = np.log(self.counts.astype(np.float32) + np.float32(100.0)).view(np.uint32)
        return samples, segments


class ClusteringLoss:
    """Buffers and dispatches of L_CC for pictures of one size. Buffers grow with the samples.

    Parameters
    ----------
    frame : Frame
        With features. The loss is added to its ``loss_values``, the gradient to its ``gradient``.
    """

    def __init__(self, frame: Frame) -> None:
        self._frame = frame
        self._sizes = (0, 0)
        self._uniform = frame._uniform(16)
        self._submissions: Submissions | None = None

    def prepared(self, sample: ClusteringSample) -> Submissions:
        """Copy a sample to the card and return the dispatches of its loss, to be run before the backward pass."""
        samples, segments = sample.packed
        wanted = (len(samples), len(segments))
        if self._submissions is None or any(n > held for n, held in zip(wanted, self._sizes, strict=True)):
            self._sizes = with_room(wanted[0], self._sizes[0]), with_room(wanted[1], self._sizes[1])
            self._submissions = self._made()
        constants = np.array([*wanted, 0, -(-len(samples) // _SAMPLES)], np.uint32)
        constants[2] = np.float32(sample.weight / len(segments)).view(np.uint32)
        self._uniform.write(constants)
        self._frame.write("samples", samples)
        self._frame.write("segments", segments)
        return self._submissions

    def _made(self) -> Submissions:
        """Make the buffers and return the dispatches on them."""
        frame = self._frame
        n_samples, n_segments = self._sizes
        chunks = frame.size.n_out // 4
        sizes: Mapping[str, int] = {
            "samples": 16 * n_samples, "segments": 16 * n_segments, "lengths": 4 * n_samples,
            "units": 16 * chunks * n_samples, "unit_gradients": 16 * chunks * n_samples, "normalisers": 4 * n_samples,
            "centers": 16 * (chunks + 1) * n_segments, "center_gradients": 16 * chunks * n_segments,
            "clustering_sums": 16 * -(-n_samples // _SAMPLES),
        }  # fmt: skip
        frame.allocate(sizes)

        def step(kernel: str, names: Sequence[str], n_groups: int) -> Any:
            return frame._step("clustering", kernel, self._uniform, names, n_groups)

        by_sample, by_segment = -(-n_samples // 128), n_segments
        pixels = ["samples", "units", "lengths", "unit_gradients", "center_gradients", "gradient"]
        return frame._submissions(
            [
                step("clustering_units", ["samples", "image", "units", "lengths"], by_sample),
                step("clustering_centers", ["samples", "segments", "units", "centers"], by_segment),
                step(
                    "clustering_losses",
                    ["samples", "segments", "units", "centers", "unit_gradients", "normalisers", "clustering_sums"],
                    -(-n_samples // _SAMPLES),
                ),
                step(
                    "clustering_center_gradients",
                    ["samples", "segments", "units", "centers", "normalisers", "center_gradients"],
                    by_segment,
                ),
                step("clustering_pixels", pixels, by_sample),
                step("clustering_total", ["clustering_sums", "loss_values"], 1),
            ]
        )
