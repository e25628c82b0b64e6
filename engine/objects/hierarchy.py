"""Hierarchical clustering of a scene's Gaussians by feature and position: nested groups and their prominence.

See docs/design_notes/objects.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from .views import MIN_GROUPED_OPACITY, Views

__all__ = ["UNGROUPED_PROMINENCE", "Hierarchy", "build_hierarchy"]

Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]
Mask = NDArray[np.bool_]

_SAMPLE_SIZE = 12_000  # chosen on museum_room, store_room
"""Gaussians that are clustered. Every other Gaussian joins the group of its nearest neighbour in the sample."""

_MIN_GROUP_SHARE = 1 / 240  # chosen on museum_room, store_room
"""Smallest group as a share of the sample. Of 40,000 Gaussians of a room the smallest exhibit has 240."""

_POSITION_WEIGHT = 0.3  # chosen on museum_room, store_room
"""Weight of a position, in units of the cameras' spread, relative to a feature of unit length."""

UNGROUPED_PROMINENCE = 0.3  # chosen on museum_room, store_room
"""Prominence of a set of Gaussians that resembles none of the groups."""

_MIN_GROUP_IOU = 0.5  # chosen on museum_room, store_room
"""Smallest IoU with a group at which a set of Gaussians takes that group's prominence."""

_N_NEIGHBOURS = 8  # chosen on museum_room, store_room
"""Nearest neighbours that a Gaussian is linked to."""

_MAX_DISTANCE = 3.0  # chosen on museum_room, store_room
"""Largest distance from the scene's median along an axis, in units of the cameras' spread. Objects are not farther."""


@dataclass(frozen=True)
class Hierarchy:
    """Nested groups of the Gaussians of one scene.

    Attributes
    ----------
    finest : int32 array of shape [N]
        The finest group of each Gaussian; -1 for a Gaussian without a group.
    groups : int32 array of shape [K, 2]
        Group k consists of the finest groups ``groups[k, 0]`` to ``groups[k, 1] - 1``. Two groups are either nested or
        disjoint.
    prominence : float32 array of shape [K]
        1 - a / b, in [0, 1]: a is the distance at which the parts of the group were merged, b the distance at which the
        group was merged with another one. It is low for a part of an object and for an object with its support.
    """

    finest: Int32
    groups: Int32
    prominence: Float32

    @property
    def n_finest(self) -> int:
        """Number of finest groups."""
        return int(self.groups[:, 1].max()) if len(self.groups) else 0

    def members(self, group: int) -> Mask:
        """Return the Gaussians of a group, bool [N]."""
        return self.within(self.finest, group)

    def prominence_of(self, members: Mask) -> float:
        """Return the prominence of the group with the highest IoU with `members`, bool [N].

        Without a similar group it is `UNGROUPED_PROMINENCE`.
        """
        if len(self.groups) == 0:
            return UNGROUPED_PROMINENCE
        grouped = self.finest >= 0
        starts = np.zeros((2, self.n_finest + 1), np.int64)
        for row, selected in zip(starts, (grouped, grouped & members), strict=True):
            row[1:] = np.cumsum(np.bincount(self.finest[selected], minlength=self.n_finest))
        sizes, common = starts[:, self.groups[:, 1]] - starts[:, self.groups[:, 0]]
        iou = common / np.maximum(1, sizes + int(members.sum()) - common)
        best = int(iou.argmax())
        return float(self.prominence[best]) if iou[best] >= _MIN_GROUP_IOU else UNGROUPED_PROMINENCE

    def membership_matrix(self) -> csr_matrix:
        """Return the Gaussians of all groups as a sparse matrix of 0 and 1, shape [N, K], float32."""
        grouped = np.flatnonzero(self.finest >= 0)
        finest = csr_matrix(
            (np.ones(len(grouped), np.float32), (grouped, self.finest[grouped])),
            shape=(len(self.finest), self.n_finest),
        )
        numbers = np.arange(self.n_finest)[:, None]
        inside = (numbers >= self.groups[:, 0]) & (numbers < self.groups[:, 1])
        return csr_matrix(finest @ csr_matrix(inside.astype(np.float32)))

    def cut(self, scores: NDArray[np.floating]) -> list[int]:
        """Return the disjoint groups with the largest sum of `scores`, [K]; of a group and its parts, the group.

        Dynamic programming from the finest groups up: a group is taken unless its parts score more.
        """
        pending: list[tuple[int, float, list[int]]] = []
        for group in np.lexsort((self.groups[:, 1] - self.groups[:, 0], self.groups[:, 1])):
            first, taken, total = int(self.groups[group, 0]), list[int](), 0.0
            while pending and pending[-1][0] >= first:
                _, part_total, part = pending.pop()
                total, taken = total + part_total, part + taken
            best = (float(scores[group]), [int(group)])
            pending.append((first, *(best if best[0] >= total else (total, taken))))
        return [group for _, _, taken in pending for group in taken]

    def within(self, finest: NDArray[np.integer], group: int) -> Mask:
        """Return where an array of finest groups belongs to `group`, as a bool array of the same shape."""
        first, stop = self.groups[group]
        return np.asarray((finest >= first) & (finest < stop))


def build_hierarchy(views: Views, *, seed: int = 0) -> Hierarchy:  # by definition
    """Cluster the Gaussians of a scene into nested groups.

    Parameters
    ----------
    views : Views
        Views of a scene with features.
    seed : int
        Random seed of the sample.

    Returns
    -------
    Hierarchy

    Notes
    -----
    Ward's linkage (1963) of feature and position on 12,000 Gaussians, restricted to the graph of each Gaussian's 8
    nearest neighbours, so that only connected Gaussians are merged. A merge counts as one of two groups if both have
    the minimum size. Otherwise the larger one absorbs a fragment.
    """
    means = views.scene.gaussians.means
    unit = views.cameras_spread
    positions = ((means - np.median(means, axis=0)) / unit).astype(np.float32)
    points = np.hstack([views.directions, _POSITION_WEIGHT * positions])
    inside = np.abs(positions).max(axis=1) < _MAX_DISTANCE
    near = np.flatnonzero(inside & (views.scene.gaussians.opacities > MIN_GROUPED_OPACITY))
    sample = np.random.default_rng(seed).permutation(near)[:_SAMPLE_SIZE]
    min_size = max(5, round(_MIN_GROUP_SHARE * len(sample)))
    finest, groups, prominence = _cluster(points[sample], _neighbour_graph(means[sample]), min_size)
    result = np.full(len(means), -1, np.int32)
    grouped = finest >= 0
    if grouped.any():
        nearest = cKDTree(points[sample[grouped]]).query(points[inside], workers=2)[1]
        result[inside] = finest[grouped][nearest]
    return Hierarchy(result, groups, prominence)


def _neighbour_graph(points: Float32) -> csr_matrix:
    """Return the symmetric graph of nearest neighbours, [n, n]."""
    count = len(points)
    n_neighbours = min(_N_NEIGHBOURS, count - 1)
    if n_neighbours < 1:
        return csr_matrix((count, count))
    nearest = cKDTree(points).query(points, k=n_neighbours + 1)[1][:, 1:]
    rows = np.repeat(np.arange(count), n_neighbours)
    graph = coo_matrix((np.ones(rows.size), (rows, nearest.ravel())), shape=(count, count))
    return csr_matrix(graph + graph.T)


def _cluster(points: Float32, graph: csr_matrix, min_size: int) -> tuple[Int32, Int32, Float32]:
    """Return `Hierarchy.finest` of the sample, `Hierarchy.groups` and `Hierarchy.prominence`."""
    from sklearn.cluster import ward_tree

    finest = np.full(len(points), -1, np.int32)
    groups: list[tuple[int, int]] = []
    prominence: list[float] = []
    n_components, component_of = connected_components(graph, directed=False)
    trees: list[tuple[NDArray[np.intp], _MergeTree]] = []
    for component in range(n_components):
        rows = np.flatnonzero(component_of == component)
        if len(rows) >= min_size:
            children, *_, distances = ward_tree(
                points[rows].astype(np.float64), connectivity=graph[rows][:, rows], return_distance=True
            )
            trees.append((rows, _MergeTree(children, distances, min_size)))
    max_distance = max((tree.distance for _, tree in trees), default=0.0)
    for rows, tree in trees:
        first = max((stop for _, stop in groups), default=0)
        for group in tree.groups(max_distance):
            if group.is_finest:
                finest[rows[group.samples]] = first + group.first
            groups.append((first + group.first, first + group.stop))
            prominence.append(group.prominence)
    return finest, np.array(groups, np.int32).reshape(-1, 2), np.array(prominence, np.float32)


@dataclass(frozen=True)
class _Group:
    """A group of one tree: its finest groups are `first` to `stop` - 1. Only a finest group lists its `samples`."""

    first: int
    stop: int
    prominence: float
    samples: NDArray[np.intp]

    @property
    def is_finest(self) -> bool:
        return len(self.samples) > 0


class _MergeTree:
    """Binary tree of merges.

    Parameters
    ----------
    children : array of shape [n - 1, 2]
        As returned by scikit-learn: merge i creates node n + i from two nodes. Nodes below n are samples.
    distances : array of shape [n - 1]
        Distance of each merge.
    min_size : int
        Number of samples in the smallest group.
    """

    def __init__(self, children: NDArray[np.integer], distances: NDArray[np.float64], min_size: int) -> None:
        self._children, self._distances, self._min_size = children, distances, min_size
        self._n = n = len(children) + 1
        self._sizes = np.ones(2 * n - 1, np.int64)
        for i, (left, right) in enumerate(children):
            self._sizes[n + i] = self._sizes[left] + self._sizes[right]

    @property
    def distance(self) -> float:
        """Distance of the last merge."""
        return self._distance(2 * self._n - 2)

    def groups(self, root_distance: float) -> Iterator[_Group]:
        """Yield all groups, parts before wholes. The finest groups of a group are numbered consecutively.

        Parameters
        ----------
        root_distance : float
            Distance assigned to the merge of the whole tree with another one, which never happened.
        """
        no_samples = np.zeros(0, np.intp)
        n_finest = 0
        # Node, distance at which it is merged with another, and, once its parts are done, its first finest group.
        stack: list[tuple[int, float, int | None]] = [(2 * self._n - 2, root_distance, None)]
        while stack:
            node, parent_distance, first = stack.pop()
            split = self._split(node)
            distance = self._distance(node if split is None else split)
            # Where only neighbours may merge, a later merge may have a smaller distance.
            prominence = max(0.0, 1.0 - distance / parent_distance) if parent_distance > 0 else 0.0
            if first is not None:
                yield _Group(first, n_finest, prominence, no_samples)
            elif split is None:
                yield _Group(n_finest, n_finest + 1, prominence, self._samples(node))
                n_finest += 1
            else:
                left, right = (int(child) for child in self._children[split - self._n])
                stack += [(node, parent_distance, n_finest), (right, distance, None), (left, distance, None)]

    def _distance(self, node: int) -> float:
        return float(self._distances[node - self._n]) if node >= self._n else 0.0

    def _split(self, node: int) -> int | None:
        """Return the merge of two groups that a node consists of, without absorbed fragments; None for one group."""
        while node >= self._n:
            left, right = (int(child) for child in self._children[node - self._n])
            if min(self._sizes[left], self._sizes[right]) >= self._min_size:
                return node
            node = left if self._sizes[left] >= self._sizes[right] else right
        return None

    def _samples(self, node: int) -> NDArray[np.intp]:
        """Return the samples below `node`."""
        samples, stack = [], [node]
        while stack:
            current = stack.pop()
            if current < self._n:
                samples.append(current)
            else:
                stack += [int(child) for child in self._children[current - self._n]]
        return np.array(samples, np.intp)
