"""Losses on features: contrastive clustering over segments, smoothness in space, and agreement along rays.

L = L_rendering + lambda_clustering L_CC + L_reg (Dahaghin et al. 2024); L_rendering is in ``rasterizer.loss``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = [
    "LabelledPixels",
    "clustering_loss",
    "drawn_anchors",
    "drawn_of_paper",
    "drawn_pixels",
    "labelled_pixels",
    "nearest_neighbours",
    "neighbour_regulariser",
    "paper_regulariser",
    "ray_disagreement",
]

N_NEIGHBOURS = 6  # chosen on museum_room
"""Nearest other Gaussians of each, for `neighbour_regulariser`."""

N_ANCHORS = 1000  # published: Dahaghin et al. 2024
"""Random Gaussians that L_reg is evaluated on, as in the released code of Dahaghin et al. 2024."""

N_FAR = 5  # published: Dahaghin et al. 2024
"""Largest number of far Gaussians per anchor, as in the released code."""

N_FAR_CANDIDATES = 16  # chosen on museum_room
"""Random Gaussians per anchor among which far ones are searched."""

LAMBDA_PULL = 0.05  # published: Dahaghin et al. 2024
LAMBDA_PUSH = 0.15  # published: Dahaghin et al. 2024
"""Weights of the two parts of L_reg, as the paper states them: see docs/paper.md."""

PAPER_SUBSET = 300_000  # published: Dahaghin et al. 2024
"""Random Gaussians that `paper_regulariser` is restricted to, as in the released code."""


@dataclass(frozen=True)
class LabelledPixels:
    """The pixels of one picture that lie in segments of enough pixels.

    Attributes
    ----------
    index : array of shape [P], int32
        Number of each pixel, row by row.
    cluster : array of shape [P], int32
        Segment of each pixel, 0 to n_p - 1.
    counts : tensor of shape [n_p], float32
        Number of pixels of each segment.
    """

    index: NDArray[np.int32]
    cluster: NDArray[np.int32]
    counts: torch.Tensor

    def __len__(self) -> int:
        return len(self.index)


def labelled_pixels(labels: NDArray[np.int32], *, min_pixels: int) -> LabelledPixels | None:
    """Return the pixels of `labels` [h, w] in segments of more than `min_pixels`; None for fewer than two segments.

    A contrastive loss on one segment is constant.
    """
    flat = np.maximum(labels.ravel(), 0)
    counts = np.bincount(flat)
    kept = counts > min_pixels
    kept[0] = False
    if kept.sum() < 2:
        return None
    renumbered = np.where(kept, np.cumsum(kept) - 1, -1)[flat]
    index = np.flatnonzero(renumbered >= 0)
    return LabelledPixels(
        index.astype(np.int32),
        renumbered[index].astype(np.int32),
        torch.from_numpy(counts[kept].astype(np.float32)),
    )


def clustering_loss(
    features: torch.Tensor,
    labelled: LabelledPixels,
    *,
    n_samples: int = 0,  # by definition
    generator: torch.Generator | None = None,
) -> torch.Tensor:
    """Return L_CC of one picture: a sum over its labelled pixels, divided by the number of segments.

    Parameters
    ----------
    features : tensor of shape [h, w, F]
        Rendered features, blended like colour, without background.
    labelled : LabelledPixels
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
    drawn, weight = drawn_pixels(labelled, n_samples, generator)
    index, cluster = torch.from_numpy(labelled.index)[drawn], torch.from_numpy(labelled.cluster)[drawn].long()
    f = features.reshape(-1, features.shape[-1])[index.long()]
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
) -> tuple[torch.Tensor | slice, float]:
    """Return which labelled pixels are drawn, all of them for 0, and the weight of each."""
    if not 0 < n_samples < len(labelled):
        return slice(None), 1.0
    return torch.randint(len(labelled), (n_samples,), generator=generator), len(labelled) / n_samples


def _temperatures(
    f: torch.Tensor, means: torch.Tensor, cluster: torch.Tensor, sampled: torch.Tensor, counts: torch.Tensor
) -> torch.Tensor:
    distance = (f - means[cluster]).norm(dim=1)
    mean_distance = torch.zeros_like(counts).index_add(0, cluster, distance) / sampled.clamp_min(1).to(f.dtype)
    return (10.0 * mean_distance / torch.log(counts + 100.0)).clamp(0.1, 1.0)


def nearest_neighbours(means: torch.Tensor, k: int = N_NEIGHBOURS) -> torch.Tensor:
    """Return the `k` nearest other Gaussians of each one, shape [N, k], int32; for N <= k all others, repeated.

    Parameters
    ----------
    means : tensor of shape [N, 3]
        Centres; N is at least 2.
    k : int
    """
    points = means.detach().cpu().numpy()
    available = min(k, len(points) - 1)
    _, index = cKDTree(points).query(points, k=available + 1)
    # The tree may list a coincident point before the point itself, which is therefore dropped wherever it is listed.
    own = index == np.arange(len(points))[:, None]
    own[~own.any(axis=1), -1] = True
    neighbours = index[~own].reshape(len(points), available)
    return torch.from_numpy(np.resize(neighbours.T, (k, len(points))).T.astype(np.int32).copy())


def neighbour_regulariser(
    features: torch.Tensor,
    means: torch.Tensor,
    neighbours: torch.Tensor,
    *,
    far: float,
    lambda_pull: float = LAMBDA_PULL,
    lambda_push: float = LAMBDA_PUSH,
    generator: torch.Generator,
) -> torch.Tensor:
    """Return L_reg with the nearest other Gaussians and random far ones.

    Parameters
    ----------
    features : tensor of shape [N, F]
        Features of the Gaussians.
    means : tensor of shape [N, 3]
        Centres; no gradient flows to them.
    neighbours : tensor of shape [N, k], int
        Result of `nearest_neighbours`.
    far : float
        Distance beyond which features are pushed apart, world units.
    lambda_pull, lambda_push : float
        Weights.
    generator : torch.Generator
        Draws 1,000 anchors and for each 16 candidates, of which the first 5 far ones are used.

    Returns
    -------
    tensor, scalar

    Notes
    -----
    ``lambda_pull s(1 - mean cos(near)) + lambda_push s(mean cos(far))`` with s the logistic function. The published
    form (`paper_regulariser`) includes a Gaussian among its neighbours, and pushes the same few outliers for all
    anchors.
    """
    anchors, tries = drawn_anchors(len(features), generator)
    unit = torch.nn.functional.normalize(features, dim=1, eps=1e-9)
    near = (unit[anchors, None] * unit[neighbours[anchors].long()]).sum(dim=2)
    loss = lambda_pull * torch.sigmoid(1.0 - near.mean())
    places = means.detach()
    is_far = (places[anchors, None] - places[tries]).norm(dim=2) > far
    is_far &= is_far.cumsum(dim=1) <= N_FAR
    if bool(is_far.any()):
        row, column = is_far.nonzero(as_tuple=True)
        distant = (unit[anchors[row]] * unit[tries[row, column]]).sum(dim=1)
        loss = loss + lambda_push * torch.sigmoid(distant.mean())
    return loss


def drawn_anchors(n: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
    """Draw the rows of `neighbour_regulariser` from `n`: anchors [A], and candidates for far Gaussians [A, 16]."""
    anchors = torch.randint(n, (min(N_ANCHORS, n),), generator=generator)
    return anchors, torch.randint(n, (len(anchors), N_FAR_CANDIDATES), generator=generator)


def drawn_of_paper(n: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
    """Draw the rows of `paper_regulariser` from `n`: the subset, and the places of the anchors in it."""
    subset = torch.randperm(n, generator=generator)[:PAPER_SUBSET]
    return subset, torch.randperm(len(subset), generator=generator)[:N_ANCHORS]


def paper_regulariser(
    features: torch.Tensor,
    means: torch.Tensor,
    *,
    lambda_pull: float = LAMBDA_PULL,
    lambda_push: float = LAMBDA_PUSH,
    generator: torch.Generator,
    n_near: int = 2,  # published: Dahaghin et al. 2024
    n_far: int = 5,  # published: Dahaghin et al. 2024
) -> torch.Tensor:
    """Return L_reg as the released code of Dahaghin et al. 2024 computes it.

    Parameters
    ----------
    features : tensor of shape [N, F]
    means : tensor of shape [N, 3]
        Centres; no gradient flows to them.
    lambda_pull, lambda_push : float
        Weights.
    generator : torch.Generator
        Draws the 300,000 Gaussians and the 1,000 anchors.
    n_near, n_far : int
        Numbers of nearest (which include the anchor) and farthest Gaussians per anchor.

    Returns
    -------
    tensor, scalar
    """
    subset, anchors = drawn_of_paper(len(features), generator)
    places = means.detach()[subset]
    unit = torch.nn.functional.normalize(features[subset], dim=1, eps=1e-9)
    distances = torch.cdist(places[anchors], places)
    near = distances.topk(min(n_near, len(subset)), largest=False).indices
    distant = distances.topk(min(n_far, len(subset))).indices
    near_cosine = (unit[anchors, None] * unit[near]).sum(dim=2).mean()
    far_cosine = (unit[anchors, None] * unit[distant]).sum(dim=2).mean()
    return lambda_pull * torch.sigmoid(1.0 - near_cosine) + lambda_push * torch.sigmoid(far_cosine)


def ray_disagreement(features: torch.Tensor, transmittance: torch.Tensor) -> torch.Tensor:
    """Return the mean variance of unit features along the rays of a picture.

    Parameters
    ----------
    features : tensor of shape [h, w, F]
        Blended features F = sum_g w_g f_g with |f_g| = 1.
    transmittance : tensor of shape [h, w]
        1 - A with A = sum_g w_g.

    Returns
    -------
    tensor, scalar
        Mean of A^2 - |F|^2 = sum_gh w_g w_h (1 - f_g . f_h), which is 0 exactly where all features along a ray agree.

    Notes
    -----
    The variance regulariser of OpenSplat3D (CVPRW 2025) without its second rendering: for unit features the blended
    squares equal A.
    """
    cover = 1.0 - transmittance
    return (cover.square() - features.square().sum(dim=2)).mean()
