"""A scene falls into groups within groups: Gaussians side by side whose features are most alike are joined first.

Of 22 exhibits in two generated rooms, the best of each room's 250 groups had a mean IoU of 0.80 with the Gaussians that
truly belong; only that of a mirror, which shows the rest of the room, was below 0.65.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from .views import Views

__all__ = ["UNGROUPED", "Hierarchy", "build_hierarchy"]

Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]
Mask = NDArray[np.bool_]

_SAMPLE = 12_000
_LEAST_SHARE = 1 / 240
"""Of the sample, in the smallest groups. Of a room's 40,000 Gaussians the smallest exhibit has 240."""

_PLACE_WEIGHT = 0.3
"""Of a position, in units of the cameras' spread, beside a feature of unit length; 0.15 and 0.6 found the same."""

UNGROUPED = 0.3
"""How much stands out what is like none of the groups."""

_ALIKE = 0.5
"""IoU of Gaussians from which on a set of them is like a group."""

_NEIGHBOURS = 8
_REACH = 3.0
"""In units of the cameras' spread: what is farther away is no exhibit."""


@dataclass(frozen=True)
class Hierarchy:
    """Groups of one scene.

    Attributes
    ----------
    finest : int32 array of shape [N]
        The finest group of each Gaussian, -1 for what is in none.
    groups : int32 array of shape [K, 2]
        Group k is the finest groups ``groups[k, 0]`` to ``groups[k, 1] - 1``. Two groups lie one in the other or apart.
    standing : float32 array of shape [K]
        How much a group stands out, 0 to 1: 1 - a / b of the distance a at which its own parts were joined and b at
        which it was joined to another. A part of an object, or an object and what it stands on, is low.
    """

    finest: Int32
    groups: Int32
    standing: Float32

    @property
    def n_finest(self) -> int:
        """How many finest groups there are."""
        return int(self.groups[:, 1].max()) if len(self.groups) else 0

    def members(self, group: int) -> Mask:
        """Return the Gaussians of a group, bool [N]."""
        return self.within(self.finest, group)

    def standing_of(self, members: Mask) -> float:
        """Return how much members, bool [N], stand out: `standing` of the group most like them, `UNGROUPED` of none."""
        if len(self.groups) == 0:
            return UNGROUPED
        grouped = self.finest >= 0
        starts = np.zeros((2, self.n_finest + 1), np.int64)
        for row, among in zip(starts, (grouped, grouped & members), strict=True):
            row[1:] = np.cumsum(np.bincount(self.finest[among], minlength=self.n_finest))
        sizes, common = starts[:, self.groups[:, 1]] - starts[:, self.groups[:, 0]]
        likeness = common / np.maximum(1, sizes + int(members.sum()) - common)
        best = int(likeness.argmax())
        return float(self.standing[best]) if likeness[best] >= _ALIKE else UNGROUPED

    def within(self, finest: NDArray[np.integer], group: int) -> Mask:
        """Return which of an array of finest groups are part of `group`."""
        first, stop = self.groups[group]
        return np.asarray((finest >= first) & (finest < stop))


def build_hierarchy(views: Views, *, seed: int = 0) -> Hierarchy:
    """Return the groups of a scene with features.

    Parameters
    ----------
    views : Views
    seed : int
        Of the sample.

    Notes
    -----
    Ward's linkage (1963) of feature and position over each Gaussian's 8 nearest neighbours, on 12,000 Gaussians: only
    what hangs together is ever joined. A join counts as one of two groups when both have a least size, else as the
    larger one with a crumb. Every other Gaussian goes with the nearest of the sample.
    """
    means = views.scene.gaussians.means
    unit = views.cameras_spread
    places = ((means - np.median(means, axis=0)) / unit).astype(np.float32)
    described = np.hstack([views.directions, _PLACE_WEIGHT * places])
    inside = np.abs(places).max(axis=1) < _REACH
    near = np.flatnonzero(inside & (views.scene.gaussians.opacities > 0.1))
    picked = np.random.default_rng(seed).permutation(near)[:_SAMPLE]
    least = max(5, round(_LEAST_SHARE * len(picked)))
    finest, groups, standing = _grouped(described[picked], _neighbours(means[picked]), least)
    result = np.full(len(means), -1, np.int32)
    known = finest >= 0
    if known.any():
        nearest = cKDTree(described[picked[known]]).query(described[inside], workers=2)[1]
        result[inside] = finest[known][nearest]
    return Hierarchy(result, groups, standing)


def _neighbours(points: Float32) -> csr_matrix:
    """Return who is beside whom, symmetric [n, n]."""
    count = len(points)
    n_neighbours = min(_NEIGHBOURS, count - 1)
    if n_neighbours < 1:
        return csr_matrix((count, count))
    nearest = cKDTree(points).query(points, k=n_neighbours + 1)[1][:, 1:]
    rows = np.repeat(np.arange(count), n_neighbours)
    beside = coo_matrix((np.ones(rows.size), (rows, nearest.ravel())), shape=(count, count))
    return csr_matrix(beside + beside.T)


def _grouped(described: Float32, beside: csr_matrix, least: int) -> tuple[Int32, Int32, Float32]:
    """Return `Hierarchy.finest` of the sample, `Hierarchy.groups` and `Hierarchy.standing`."""
    from sklearn.cluster import ward_tree

    finest = np.full(len(described), -1, np.int32)
    groups: list[tuple[int, int]] = []
    standing: list[float] = []
    n_parts, part_of = connected_components(beside, directed=False)
    trees: list[tuple[NDArray[np.intp], _Joins]] = []
    for part in range(n_parts):
        own = np.flatnonzero(part_of == part)
        if len(own) >= least:
            children, *_, heights = ward_tree(
                described[own].astype(np.float64), connectivity=beside[own][:, own], return_distance=True
            )
            trees.append((own, _Joins(children, heights, least)))
    highest = max((joins.height for _, joins in trees), default=0.0)
    for own, joins in trees:
        first = max((stop for _, stop in groups), default=0)
        for group in joins.groups(highest):
            if group.finest:
                finest[own[group.things]] = first + group.first
            groups.append((first + group.first, first + group.stop))
            standing.append(group.standing)
    return finest, np.array(groups, np.int32).reshape(-1, 2), np.array(standing, np.float32)


@dataclass(frozen=True)
class _Group:
    """Of one tree: finest groups `first` to `stop` - 1; `things` of a finest group, else none."""

    first: int
    stop: int
    standing: float
    things: NDArray[np.intp]

    @property
    def finest(self) -> bool:
        return len(self.things) > 0


class _Joins:
    """A tree of joins of two.

    Parameters
    ----------
    children : array of shape [n - 1, 2]
        As scikit-learn gives them: join i makes number n + i of two things (below n) or joins.
    heights : array of shape [n - 1]
        Distance at which each was made.
    least : int
        Things in the smallest group.
    """

    def __init__(self, children: NDArray[np.integer], heights: NDArray[np.float64], least: int) -> None:
        self._children, self._heights, self._least = children, heights, least
        self._n = n = len(children) + 1
        self._sizes = np.ones(2 * n - 1, np.int64)
        for i, (one, other) in enumerate(children):
            self._sizes[n + i] = self._sizes[one] + self._sizes[other]

    @property
    def height(self) -> float:
        """Distance of the last join."""
        return self._height(2 * self._n - 2)

    def groups(self, joined: float) -> Iterator[_Group]:
        """Yield all groups, parts before wholes, finest groups numbered so that each group's follow each other.

        Parameters
        ----------
        joined : float
            Distance that stands for that at which the whole tree, which hangs together with nothing, is joined.
        """
        nothing = np.zeros(0, np.intp)
        n_finest = 0
        # Node, height at which it is joined to another, and the finest groups before its own once its parts are done.
        waiting: list[tuple[int, float, int | None]] = [(2 * self._n - 2, joined, None)]
        while waiting:
            node, height_above, begun = waiting.pop()
            split = self._split(node)
            height = self._height(node if split is None else split)
            # Where only neighbours may join, what was joined later may have been nearer.
            standing = max(0.0, 1.0 - height / height_above) if height_above > 0 else 0.0
            if begun is not None:
                yield _Group(begun, n_finest, standing, nothing)
            elif split is None:
                yield _Group(n_finest, n_finest + 1, standing, self._below(node))
                n_finest += 1
            else:
                one, other = (int(child) for child in self._children[split - self._n])
                waiting += [(node, height_above, n_finest), (other, height, None), (one, height, None)]

    def _height(self, node: int) -> float:
        return float(self._heights[node - self._n]) if node >= self._n else 0.0

    def _split(self, node: int) -> int | None:
        """Return the join of two groups that a node consists of, without the crumbs that joined it one by one."""
        while node >= self._n:
            one, other = (int(child) for child in self._children[node - self._n])
            if min(self._sizes[one], self._sizes[other]) >= self._least:
                return node
            node = one if self._sizes[one] >= self._sizes[other] else other
        return None

    def _below(self, node: int) -> NDArray[np.intp]:
        """Return the things that are joined in `node`."""
        found, waiting = [], [node]
        while waiting:
            one = waiting.pop()
            if one < self._n:
                found.append(one)
            else:
                waiting += [int(child) for child in self._children[one - self._n]]
        return np.array(found, np.intp)
