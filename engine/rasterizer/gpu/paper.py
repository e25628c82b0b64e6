"""L_reg as Dahaghin et al. 2024 compute it, on a card: the nearest and the farthest Gaussians of a random subset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .adapters import Gpu
from .neighbours import NeighbourSample
from .parameters import GpuParameters
from .submissions import encode
from .workspace import Workspace

__all__ = ["PaperSample", "neighbours_of"]

_NEAR, _FAR = 2, 5  # as in extremes.wgsl

_ANCHORS = 128
"""Anchors in one submission, so that slow cards are not kept busy for too long."""


@dataclass(frozen=True)
class PaperSample:
    """Gaussians that L_reg of the paper is evaluated on, drawn by the caller.

    Attributes
    ----------
    subset : int array of shape [S]
        Different Gaussians, among which the 2 nearest, with the anchor itself, and the 5 farthest are found.
    anchors : int array of shape [A]
        Places in `subset`.
    lambda_pull, lambda_push : float

    Raises
    ------
    ValueError
        If there is nothing to evaluate, or an anchor is not in the subset.
    """

    subset: NDArray[np.integer[Any]]
    anchors: NDArray[np.integer[Any]]
    lambda_pull: float
    lambda_push: float

    def __post_init__(self) -> None:
        if self.subset.ndim != 1 or self.anchors.ndim != 1 or not len(self.anchors):
            raise ValueError(f"a subset has anchors, got shapes {self.subset.shape} and {self.anchors.shape}")
        if self.anchors.min() < 0 or self.anchors.max() >= len(self.subset) or self.subset.min() < 0:
            raise ValueError(f"anchors are places in a subset of {len(self.subset)} Gaussians")

    @property
    def n_needed(self) -> int:
        """Number of Gaussians that there have to be."""
        return int(self.subset.max()) + 1


def neighbours_of(sample: PaperSample, gpu: Gpu, parameters: GpuParameters, pool: dict[str, Any]) -> NeighbourSample:
    """Return the Gaussians that `sample` is evaluated on, by the present means on the card."""
    anchors, n = sample.subset[sample.anchors], len(sample.anchors)
    work = Workspace(gpu, f"a subset of {len(sample.subset)} Gaussians", shared=parameters.buffers, pool=pool)
    sizes = {"paper_subset": len(sample.subset), "paper_anchors": n, "paper_found": (_NEAR + _FAR) * n}
    work.allocate({"means": 12 * parameters.room, **{name: 4 * length for name, length in sizes.items()}})
    work.write("paper_subset", sample.subset.astype(np.uint32))
    work.write("paper_anchors", anchors.astype(np.uint32))
    for first in range(0, n, _ANCHORS):
        encoder = gpu.device.create_command_encoder()
        settings = work._constants(len(sample.subset), first, n)
        step = work._step("paper", "extremes", settings, ["means", *sizes], min(_ANCHORS, n - first))
        encode(encoder, [step], None)
        gpu.device.queue.submit([encoder.finish()])
    found = work.read("paper_found", (n, _NEAR + _FAR), np.uint32)
    n_near, n_far = min(_NEAR, len(sample.subset)), min(_FAR, len(sample.subset))
    near, far = found[:, :n_near], found[:, _NEAR : _NEAR + n_far]
    # All candidates are farther than a negative distance.
    return NeighbourSample(anchors, near, far, n_far, -1.0, sample.lambda_pull, sample.lambda_push)
