"""Hierarchical clustering of a scene's Gaussians by feature and position: nested groups.

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

from .views import Views

__all__ = ["Hierarchy", "build_hierarchy"]

Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]
Mask = NDArray[np.bool_]

_MIN_OPACITY = 0.1  # chosen on museum_room
"""Opacity above which a Gaussian takes part in forming groups. Fainter ones float in free space."""

_SAMPLE_SIZE = 12_000  # chosen on museum_room, store_room
"""Gaussians that are clustered. Every other Gaussian joins the group of its nearest neighbour in the sample."""

_MIN_GROUP_SHARE = 1 / 240  # chosen on museum_room, store_room
"""Smallest group as a share of the sample. Of 40,000 Gaussians of a room the smallest exhibit has 240."""

_POSITION_WEIGHT = 0.3  # chosen on museum_room, store_room
"""Weight of a position, in units of the cameras' spread, relative to a feature of unit length."""

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
    """

    finest: Int32
    groups: Int32

    @property
    def n_finest(self) -> int:
        """Number of finest groups."""
        return int(self.groups[:, 1].max()) if len(self.groups) else 0

    @property
    def members(self) -> Mask:
        """The Gaussians of all groups, bool [K, N]."""
        return (self.finest >= self.groups[:, :1]) & (self.finest < self.groups[:, 1:])

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
    near = np.flatnonzero(inside & (views.scene.gaussians.opacities > _MIN_OPACITY))
    sample = np.random.default_rng(seed).permutation(near)[:_SAMPLE_SIZE]
    min_size = max(5, round(_MIN_GROUP_SHARE * len(sample)))
    finest, groups = _cluster(points[sample], _neighbour_graph(means[sample]), min_size)
    result = np.full(len(means), -1, np.int32)
    grouped = finest >= 0
    if grouped.any():
        nearest = cKDTree(points[sample[grouped]]).query(points[inside], workers=2)[1]
        result[inside] = finest[grouped][nearest]
    return Hierarchy(result, groups)


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


def _cluster(points: Float32, graph: csr_matrix, min_size: int) -> tuple[Int32, Int32]:
    """Return `Hierarchy.finest` of the sample and `Hierarchy.groups`."""
    from sklearn.cluster import ward_tree

    finest = np.full(len(points), -1, np.int32)
    groups: list[tuple[int, int]] = []
    n_components, component_of = connected_components(graph, directed=False)
    for component in range(n_components):
        rows = np.flatnonzero(component_of == component)
        if len(rows) < min_size:
            continue
        children = ward_tree(points[rows].astype(np.float64), connectivity=graph[rows][:, rows])[0]
        first = max((stop for _, stop in groups), default=0)
        for start, stop, samples in _groups(children, min_size):
            finest[rows[samples]] = first + start
            groups.append((first + start, first + stop))
    return finest, np.array(groups, np.int32).reshape(-1, 2)


def _groups(children: NDArray[np.integer], min_size: int) -> Iterator[tuple[int, int, NDArray[np.intp]]]:
    """Yield the groups of a binary tree of merges, parts before wholes.

    Parameters
    ----------
    children : array of shape [n - 1, 2]
        As returned by scikit-learn: merge i creates node n + i from two nodes. Nodes below n are samples.
    min_size : int
        Number of samples in the smallest group.

    Yields
    ------
    (int, int, array)
        The finest groups of a group are numbered from the first number to below the second; the samples of a finest
        group, none for others.
    """
    n = len(children) + 1
    sizes = np.ones(2 * n - 1, np.int64)
    for i, (left, right) in enumerate(children):
        sizes[n + i] = sizes[left] + sizes[right]

    def split(node: int) -> int | None:
        """Return the merge of two groups that a node consists of, without absorbed fragments; None for one group."""
        while node >= n:
            left, right = (int(child) for child in children[node - n])
            if min(sizes[left], sizes[right]) >= min_size:
                return node
            node = left if sizes[left] >= sizes[right] else right
        return None

    def below(node: int) -> NDArray[np.intp]:
        samples, stack = [], [node]
        while stack:
            current = stack.pop()
            if current < n:
                samples.append(current)
            else:
                stack += [int(child) for child in children[current - n]]
        return np.array(samples, np.intp)

    n_finest = 0
    # A node and, once its parts are done, its first finest group.
    stack: list[tuple[int, int | None]] = [(2 * n - 2, None)]
    while stack:
        node, first = stack.pop()
        merge = split(node)
        if first is not None:
            yield first, n_finest, np.zeros(0, np.intp)
        elif merge is None:
            yield n_finest, n_finest + 1, below(node)
            n_finest += 1
        else:
            stack.append((node, n_finest))
            stack += [(int(child), None) for child in children[merge - n][::-1]]
