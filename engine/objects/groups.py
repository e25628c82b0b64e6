"""Nested groups of a scene's Gaussians by feature and position, from which whole objects come where photos show parts.

See docs/design_notes/objects.md.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..core.arrays import Float32, Int64, Mask
from .graph import MAX_RADII, N_NEIGHBOURS
from .views import Views

_POSITION_WEIGHT = 0.5  # chosen on museum_room, store_room
"""Weight of positions, in `Views.length_unit`, relative to features, whose length is 1."""

_SAMPLE_SIZE = 12_000  # chosen on museum_room, store_room
"""Gaussians that are clustered. Every other Gaussian joins the groups of its nearest neighbour in the sample."""

_MIN_GROUP_SHARE = 1 / 240  # chosen on museum_room, store_room
"""Smallest group as a share of the sample. Of 40,000 Gaussians of a room the smallest exhibit has 240."""


def build_groups(views: Views) -> Mask:
    """Return nested groups of the Gaussians of a scene: two of them are nested or disjoint.

    Returns
    -------
    array of shape [K, N], bool

    Notes
    -----
    Ward's linkage (1963) of features and positions on 12,000 Gaussians that are not far from the middle of the scene,
    restricted to the graph of each Gaussian's nearest neighbours, so that only connected Gaussians are merged. A node
    of the tree is a group if it and its sibling have the minimum size; a smaller sibling is a fragment that the larger
    one absorbs.
    """
    means = views.scene.gaussians.means
    positions = ((means - views.middle) / views.length_unit).astype(np.float32)
    points = np.hstack([views.directions, _POSITION_WEIGHT * positions])
    inside = np.linalg.norm(positions, axis=1) < MAX_RADII
    sample = np.random.default_rng(0).permutation(np.flatnonzero(inside))[:_SAMPLE_SIZE]
    place, spans = _cluster(points[sample], means[sample], max(N_NEIGHBOURS, round(_MIN_GROUP_SHARE * len(sample))))
    places = np.full(len(means), -1)
    grouped = place >= 0
    if grouped.any():
        nearest = cKDTree(points[sample[grouped]]).query(points[inside], workers=2)[1]
        places[inside] = place[grouped][nearest]
    return (places >= spans[:, :1]) & (places < spans[:, 1:])


def _cluster(points: Float32, means: Float32, min_size: int) -> tuple[Int64, Int64]:
    """Return the place of each of n points, -1 in no group, and the groups, [K, 2]: first place and last + 1."""
    from sklearn.cluster import ward_tree
    from sklearn.neighbors import kneighbors_graph

    graph = kneighbors_graph(means, min(N_NEIGHBOURS, len(means) - 1)) if len(means) > 1 else csr_matrix((1, 1))
    graph = graph + graph.T
    place = np.full(len(points), -1)
    spans: list[tuple[int, int]] = []
    n_placed = 0
    n_components, component_of = connected_components(graph, directed=False)
    for component in range(n_components):
        rows = np.flatnonzero(component_of == component)
        if len(rows) < min_size:
            continue
        children = ward_tree(points[rows].astype(np.float64), connectivity=graph[rows][:, rows])[0]
        first, sizes = _leaf_order(children)
        place[rows] = n_placed + first[: len(rows)]
        groups = [2 * len(rows) - 2]
        groups += [int(node) for pair in children if sizes[pair].min() >= min_size for node in pair]
        spans += [(n_placed + int(first[node]), n_placed + int(first[node] + sizes[node])) for node in groups]
        n_placed += len(rows)
    return place, np.array(spans, np.int64).reshape(-1, 2)


def _leaf_order(children: NDArray[np.integer]) -> tuple[Int64, Int64]:
    """Return for each node of a binary tree its first leaf, in an order in which every node is a run, and its leaves.

    `children` [n - 1, 2] are as scikit-learn returns them: merge i creates node n + i; the nodes below n are leaves.
    """
    n = len(children) + 1
    sizes, first = np.ones(2 * n - 1, np.int64), np.zeros(2 * n - 1, np.int64)
    for i, (left, right) in enumerate(children):
        sizes[n + i] = sizes[left] + sizes[right]
    for i in reversed(range(n - 1)):
        left, right = children[i]
        first[left], first[right] = first[n + i], first[n + i] + sizes[left]
    return first, sizes
