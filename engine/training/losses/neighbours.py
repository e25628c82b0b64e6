"""L_reg on a card: features of near Gaussians pulled together and of distant ones pushed apart."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ...rasterizer.gpu import Frame, Submissions, with_room
from ...scene import PinholeCamera
from .samples import Sample

N_NEIGHBOURS = 6  # chosen on museum_room
"""Nearest other Gaussians of each, for `neighbour_regulariser`."""

N_ANCHORS = 1000  # Dahaghin et al. 2024
"""Random Gaussians that L_reg is evaluated on, as in the released code of Dahaghin et al. 2024."""

N_FAR = 5  # Dahaghin et al. 2024
"""Largest number of far Gaussians per anchor, as in the released code."""

N_FAR_CANDIDATES = 16  # chosen on museum_room
"""Random Gaussians per anchor among which far ones are searched."""

LAMBDA_PULL = 0.05  # Dahaghin et al. 2024
LAMBDA_PUSH = 0.15  # Dahaghin et al. 2024
"""Weights of the two parts of L_reg, as the paper states them: see docs/paper.md."""

_MAX_TRIES = 32
"""Candidates of an anchor that fit the bits of a word."""


def nearest_neighbours(means: torch.Tensor, k: int = N_NEIGHBOURS) -> torch.Tensor:
    """Return the `k` nearest other Gaussians of each one, shape [N, k], int32; for N <= k all others, repeated.

    Parameters
    ----------
    means : tensor of shape [N, 3]
        Centres; N is at least 2.
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
    generator : torch.Generator
        Draws 1,000 anchors and for each 16 candidates, of which the first 5 far ones are used.

    Returns
    -------
    tensor, scalar

    Notes
    -----
    ``LAMBDA_PULL s(1 - mean cos(near)) + LAMBDA_PUSH s(mean cos(far))`` with s the logistic function. The published
    form (`paper_regulariser`) includes a Gaussian among its neighbours, and pushes the same few outliers for all
    anchors.
    """
    anchors, tries = drawn_anchors(len(features), generator)
    unit = torch.nn.functional.normalize(features, dim=1, eps=1e-9)
    near = (unit[anchors, None] * unit[neighbours[anchors].long()]).sum(dim=2)
    loss = LAMBDA_PULL * torch.sigmoid(1.0 - near.mean())
    places = means.detach()
    is_far = (places[anchors, None] - places[tries]).norm(dim=2) > far
    is_far &= is_far.cumsum(dim=1) <= N_FAR
    if bool(is_far.any()):
        row, column = is_far.nonzero(as_tuple=True)
        distant = (unit[anchors[row]] * unit[tries[row, column]]).sum(dim=1)
        loss = loss + LAMBDA_PUSH * torch.sigmoid(distant.mean())
    return loss


def drawn_anchors(n: int, generator: torch.Generator) -> tuple[torch.Tensor, torch.Tensor]:
    """Draw the rows of `neighbour_regulariser` from `n`: anchors [A], and candidates for far Gaussians [A, 16]."""
    anchors = torch.randint(n, (min(N_ANCHORS, n),), generator=generator)
    return anchors, torch.randint(n, (len(anchors), N_FAR_CANDIDATES), generator=generator)


@dataclass(frozen=True)
class NeighbourSample(Sample):
    """Gaussians that L_reg is evaluated on, drawn by the caller.

    Attributes
    ----------
    anchors : int array of shape [A]
    near : int array of shape [A, k]
        Their neighbours.
    tries : int array of shape [A, t]
        Candidates for distant Gaussians, t up to 32.
    max_far : int
        So many of them that are distant count, from the first on.
    far : float
        Distance beyond which they are distant, world units.

    Raises
    ------
    ValueError
        If shapes do not match, or there is nothing to evaluate.
    """

    anchors: NDArray[np.integer[Any]]
    near: NDArray[np.integer[Any]]
    tries: NDArray[np.integer[Any]]
    max_far: int
    far: float
    needs_features = True

    def __post_init__(self) -> None:
        n = len(self.anchors)
        if not n or self.near.ndim != 2 or self.tries.ndim != 2 or not len(self.near) == len(self.tries) == n:
            raise ValueError(f"{n} anchors have neighbours {self.near.shape} and candidates {self.tries.shape}")
        if not self.near.shape[1] or self.tries.shape[1] > _MAX_TRIES:
            raise ValueError(f"anchors have a neighbour, and at most {_MAX_TRIES} candidates")

    @functools.cached_property
    def rows(self) -> NDArray[np.uint32]:
        """Rows ``anchors`` of neighbours.wgsl."""
        return np.column_stack([self.anchors, self.near, self.tries]).astype(np.uint32)

    def sort(self) -> None:
        _ = self.pairs

    def check(self, camera: PinholeCamera, n_gaussians: int) -> None:
        if self.rows.max() >= n_gaussians:
            raise ValueError(f"the plan samples Gaussians beyond the {n_gaussians} that there are")

    def loss_on(self, frame: Frame) -> NeighbourLoss:
        return NeighbourLoss(frame)

    @functools.cached_property
    def pairs(self) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
        """``gaussians`` [R, 4] and ``pairs`` [P, 4] of neighbour_gradients.wgsl: each pair at both Gaussians."""
        rows = self.rows
        n, width = len(rows), rows.shape[1] - 1
        anchor = np.repeat(rows[:, 0], width)
        other = rows[:, 1:].reshape(-1)
        number = np.repeat(np.arange(n, dtype=np.uint32), width)
        kind = np.maximum(np.arange(width) - self.near.shape[1] + 1, 0)
        kinds = np.tile(kind, n).astype(np.uint32)
        own = np.concatenate([anchor, other])
        order = order_of(own)
        pairs = np.zeros((2 * len(anchor), 4), np.uint32)
        pairs[:, 0] = np.concatenate([other, anchor])[order]
        pairs[:, 1] = np.concatenate([number, number])[order]
        pairs[:, 2] = np.concatenate([kinds, kinds])[order]
        own = own[order]
        first = np.flatnonzero(np.diff(own, prepend=~own[:1]))
        gaussians = np.zeros((len(first), 4), np.uint32)
        gaussians[:, 0], gaussians[:, 1], gaussians[:, 2] = own[first], first, np.append(first[1:], len(pairs))
        return gaussians, pairs


def order_of(keys: NDArray[np.uint32]) -> NDArray[np.intp]:
    """Return the stable order of uint32 keys; NumPy sorts numbers several times as fast as it finds their order."""
    n_bits = np.uint64(len(keys).bit_length())
    marked = np.sort((keys.astype(np.uint64) << n_bits) | np.arange(len(keys), dtype=np.uint64))
    return (marked & ((np.uint64(1) << n_bits) - np.uint64(1))).astype(np.intp)


class NeighbourLoss:
    """Buffers and dispatches of L_reg. Buffers grow with the samples.

    Parameters
    ----------
    frame : Frame
        Of training, with features. The loss is added to its ``loss_values``, the gradient to its ``totals``.
    """

    def __init__(self, frame: Frame) -> None:
        self._frame = frame
        self._sizes: dict[str, int] = {}
        self._uniform = frame._uniform(48)
        self._submissions: Submissions | None = None

    def prepared(self, sample: NeighbourSample) -> Submissions:
        """Copy a sample to the card and return the dispatches of its loss, to be run after the backward pass."""
        frame, rows = self._frame, sample.rows
        gaussians, pairs = sample.pairs
        sizes = {"anchors": rows.nbytes, "gaussians": gaussians.nbytes, "pairs": pairs.nbytes, "distant": 4 * len(rows)}
        if self._submissions is None or any(n_bytes > self._sizes[name] for name, n_bytes in sizes.items()):
            self._sizes = {name: with_room(n_bytes, self._sizes.get(name, 0)) for name, n_bytes in sizes.items()}
            self._submissions = self._made()
        constants = np.zeros(12, np.uint32)
        constants[:6] = (
            len(rows), len(gaussians), sample.near.shape[1], sample.tries.shape[1], sample.max_far,
            frame.size.n_channels,
        )  # fmt: skip
        factors = np.array([sample.far, LAMBDA_PULL, LAMBDA_PUSH], np.float32)
        constants[6:9] = factors.view(np.uint32)
        self._uniform.write(constants)
        for name, values in (("anchors", rows), ("gaussians", gaussians), ("pairs", pairs)):
            frame.write(name, values)
        return self._submissions

    def _made(self) -> Submissions:
        """Make the buffers and return the dispatches on them."""
        frame = self._frame
        n_anchors = self._sizes["distant"] // 4
        frame.allocate({**self._sizes, "slopes": 16, "cosine_sums": 16 * -(-n_anchors // 8)})

        def step(kernel: str, names: Sequence[str], n_groups: int) -> Any:
            return frame._step("neighbours", kernel, self._uniform, names, n_groups)

        names = ["anchors", "means", "channels", "distant", "cosine_sums"]
        gradient_names = ["gaussians", "pairs", "channels", "distant", "slopes", "totals"]
        n_rows = self._sizes["gaussians"] // 16
        return frame._submissions(
            [
                step("neighbour_cosines", names, -(-n_anchors // 8)),
                step("neighbour_total", ["cosine_sums", "slopes", "loss_values"], 1),
                step("neighbour_gradients", gradient_names, -(-n_rows // 64)),
            ]
        )
