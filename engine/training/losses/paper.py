"""L_reg as Dahaghin et al. 2024 compute it: the nearest and the farthest Gaussians of a random subset."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...rasterizer.gpu import Workspace, encode
from ...scene import PinholeCamera
from .neighbours import LAMBDA_PULL, LAMBDA_PUSH, N_ANCHORS, NeighbourSample
from .samples import Sample

PAPER_SUBSET = 300_000  # Dahaghin et al. 2024
"""Random Gaussians that `paper_regulariser` is restricted to, as in the released code."""

_NEAR, _FAR = 2, 5  # Dahaghin et al. 2024
"""Nearest Gaussians of an anchor, itself among them, and farthest ones, as in extremes.wgsl."""

_ANCHORS = 128
"""Anchors in one submission, so that slow cards are not kept busy for too long."""


def drawn_of_paper(n: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
    """Draw the rows of `paper_regulariser` from `n`: the subset, and the places of the anchors in it."""
    subset = torch.randperm(n, generator=generator)[:PAPER_SUBSET]
    return subset, torch.randperm(len(subset), generator=generator)[:N_ANCHORS]


def paper_regulariser(features: torch.Tensor, means: torch.Tensor, *, generator: torch.Generator) -> torch.Tensor:
    """Return L_reg as the released code of Dahaghin et al. 2024 computes it.

    Parameters
    ----------
    features : tensor of shape [N, F]
    means : tensor of shape [N, 3]
        Centres; no gradient flows to them.
    generator : torch.Generator
        Draws the 300,000 Gaussians and the 1,000 anchors. Of each, 2 nearest (with itself) and 5 farthest count.

    Returns
    -------
    tensor, scalar
    """
    subset, anchors = drawn_of_paper(len(features), generator)
    places = means.detach()[subset]
    unit = torch.nn.functional.normalize(features[subset], dim=1, eps=1e-9)
    distances = torch.cdist(places[anchors], places)
    near = distances.topk(min(_NEAR, len(subset)), largest=False).indices
    distant = distances.topk(min(_FAR, len(subset))).indices
    near_cosine = (unit[anchors, None] * unit[near]).sum(dim=2).mean()
    far_cosine = (unit[anchors, None] * unit[distant]).sum(dim=2).mean()
    return LAMBDA_PULL * torch.sigmoid(1.0 - near_cosine) + LAMBDA_PUSH * torch.sigmoid(far_cosine)


@dataclass(frozen=True)
class PaperSample(Sample):
    """Gaussians that L_reg of the paper is evaluated on, drawn by the caller.

    Attributes
    ----------
    subset : int array of shape [S]
        Different Gaussians, among which the 2 nearest, with the anchor itself, and the 5 farthest are found.
    anchors : int array of shape [A]
        Places in `subset`.

    Raises
    ------
    ValueError
        If there is nothing to evaluate, or an anchor is not in the subset.
    """

    subset: NDArray[np.integer[Any]]
    anchors: NDArray[np.integer[Any]]
    needs_features = True

    def __post_init__(self) -> None:
        if self.subset.ndim != 1 or self.anchors.ndim != 1 or not len(self.anchors):
            raise ValueError(f"a subset has anchors, got shapes {self.subset.shape} and {self.anchors.shape}")
        if self.anchors.min() < 0 or self.anchors.max() >= len(self.subset) or self.subset.min() < 0:
            raise ValueError(f"anchors are places in a subset of {len(self.subset)} Gaussians")

    def check(self, camera: PinholeCamera, n_gaussians: int) -> None:
        if self.subset.max() >= n_gaussians:
            raise ValueError(f"the plan samples Gaussians beyond the {n_gaussians} that there are")

    def found(self, workspace: Callable[[str], Workspace], room: int) -> NeighbourSample:
        return neighbours_of(self, workspace(f"a subset of {len(self.subset)} Gaussians"), room)


def neighbours_of(sample: PaperSample, work: Workspace, room: int) -> NeighbourSample:
    """Return the Gaussians that `sample` is evaluated on, by the present ``means`` in `work`, which hold `room`."""
    anchors, n = sample.subset[sample.anchors], len(sample.anchors)
    sizes = {"paper_subset": len(sample.subset), "paper_anchors": n, "paper_found": (_NEAR + _FAR) * n}
    work.allocate({"means": 12 * room, **{name: 4 * length for name, length in sizes.items()}})
    work.write("paper_subset", sample.subset.astype(np.uint32))
    work.write("paper_anchors", anchors.astype(np.uint32))
    for first in range(0, n, _ANCHORS):
        encoder = work.gpu.device.create_command_encoder()
        settings = work._constants(len(sample.subset), first, n)
        step = work._step("paper", "extremes", settings, ["means", *sizes], min(_ANCHORS, n - first))
        encode(encoder, [step], None)
        work.gpu.device.queue.submit([encoder.finish()])
    found = work.read("paper_found", (n, _NEAR + _FAR), np.uint32)
    n_near, n_far = min(_NEAR, len(sample.subset)), min(_FAR, len(sample.subset))
    near, far = found[:, :n_near], found[:, _NEAR : _NEAR + n_far]
    # All candidates are farther than a negative distance.
    return NeighbourSample(anchors, near, far, n_far, -1.0)
