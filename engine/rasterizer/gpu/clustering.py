"""L_CC on a card: the contrastive loss on the blended features of a sample of labelled pixels."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .frame import Frame
from .layout import with_room
from .submissions import Submissions

__all__ = ["ClusteringLoss", "ClusteringSample"]

_SAMPLES = 64
"""Samples of a workgroup of clustering_losses.wgsl."""


@dataclass(frozen=True)
class ClusteringSample:
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

    def __post_init__(self) -> None:
        if not len(self.pixels) or self.pixels.shape != self.clusters.shape or self.pixels.ndim != 1:
            raise ValueError(f"a sample has one segment for each pixel, got {self.pixels.shape}, {self.clusters.shape}")
        if self.clusters.min() < 0 or self.clusters.max() >= len(self.counts) or self.pixels.min() < 0:
            raise ValueError(f"pixels of a sample are at least 0, and their segments 0 to {len(self.counts) - 1}")

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
