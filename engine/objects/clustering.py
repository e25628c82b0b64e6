"""Division of a scene into disjoint groups: HDBSCAN of features and positions, refined by votes of views.

See docs/design_notes/objects.md.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..errors import Cancelled
from ..events import StopCheck
from .lifting import snap_to_segments
from .selection import grid_components
from .views import MIN_GROUPED_OPACITY, View, Views, spread_cameras
from .voting import VoteCount

__all__ = ["cluster_scene", "vote_for_groups"]

Float32 = NDArray[np.float32]
Labels = NDArray[np.int32]

_SAMPLE_SIZE = 8000  # chosen on museum_room
"""Gaussians that are clustered. Every other Gaussian joins the cluster of its nearest neighbour in the sample."""

_MIN_CLUSTER_SHARE = 1 / 160  # chosen on museum_room
"""Smallest cluster as a share of the sample. Below it, single SAM segments of one photo become clusters."""

_MIN_SAMPLES = 15  # chosen on museum_room
"""Neighbours that make a Gaussian a core point of HDBSCAN."""

_POSITION_WEIGHT = 1.0  # chosen on museum_room
"""Weight of a position, in units of the cameras' spread, relative to a feature of unit length.

Larger weights split similar objects less well; see docs/design_notes/objects.md.
"""

_MAX_DISTANCE = 3.0  # chosen on museum_room
"""Largest distance from the scene's median along an axis, in units of the cameras' spread, of a sampled Gaussian."""

_MIN_COMPONENT_SHARE = 0.002  # chosen on museum_room
"""Smallest connected component of a cluster as a share of the scene's Gaussians. Smaller ones are in no group."""


def cluster_scene(views: Views, *, seed: int = 0) -> Labels:  # by definition
    """Cluster the Gaussians of a scene into disjoint groups.

    Parameters
    ----------
    views : Views
        Views of a scene with features.
    seed : int
        Random seed of the sample.

    Returns
    -------
    array of shape [N], int32
        Group of each Gaussian; -1 for a Gaussian without a group.

    Notes
    -----
    HDBSCAN (Campello et al. 2013) of feature and position on 8,000 Gaussians. Every other Gaussian joins the cluster of
    its nearest neighbour in the sample. Clusters are then split into spatially connected components.
    """
    from sklearn.cluster import HDBSCAN

    means = views.scene.gaussians.means
    unit = views.cameras_spread
    positions = ((means - np.median(means, axis=0)) / unit).astype(np.float32)
    points = np.hstack([views.directions, _POSITION_WEIGHT * positions])
    near = np.flatnonzero(
        (np.abs(positions).max(axis=1) < _MAX_DISTANCE) & (views.scene.gaussians.opacities > MIN_GROUPED_OPACITY)
    )
    sample = np.random.default_rng(seed).permutation(near)[:_SAMPLE_SIZE]
    min_size = max(5, round(_MIN_CLUSTER_SHARE * len(sample)))
    if len(sample) < 2 * min_size:
        return np.full(len(means), -1, np.int32)
    clusters = HDBSCAN(min_cluster_size=min_size, min_samples=min(_MIN_SAMPLES, min_size), copy=True).fit_predict(
        points[sample].astype(np.float64)
    )
    clustered = sample[clusters >= 0]
    if len(clustered) == 0:
        return np.full(len(means), -1, np.int32)
    nearest = cKDTree(points[clustered]).query(points, workers=2)[1]
    labels = clusters[clusters >= 0][nearest].astype(np.int32)
    return _split_into_components(means, labels, min_size=_MIN_COMPONENT_SHARE * len(means))


def _split_into_components(means: Float32, labels: Labels, *, min_size: float) -> Labels:
    """Return labels in which each connected component is a group; components smaller than `min_size` become -1."""
    result = np.full(len(labels), -1, np.int32)
    count = 0
    for label in range(int(labels.max()) + 1):
        members = np.flatnonzero(labels == label)
        if len(members) < min_size:
            continue
        points = means[members]
        gaps = cKDTree(points).query(points, k=min(4, len(points)))[0][:, -1]
        cell = max(4 * float(np.median(gaps)), 1e-9)
        component = grid_components(points, cell)
        for number, size in enumerate(np.bincount(component)):
            if size >= min_size:
                result[members[component == number]] = count
                count += 1
    return result


def vote_for_groups(
    views: Views,
    labels: Labels,
    label_maps: Mapping[str, Labels],
    *,
    n_views: int,
    should_stop: StopCheck,
) -> tuple[Float32, list[tuple[str, Labels]]]:
    """Refine all groups at once by votes of views.

    Parameters
    ----------
    views : Views
    labels : array of shape [N], int32
        As returned by `cluster_scene`.
    label_maps : mapping of str to int32 array
        SAM label maps by photo. Groups take the outlines of the segments that they fill.
    n_views : int
        Largest number of views.
    should_stop : callable

    Returns
    -------
    array of shape [N, K], float32
        Membership of each Gaussian in each of K groups, in [0, 1].
    list of (str, int32 array of shape [h, w])
        Photo and group of each pixel for each view; -1 for no group.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    """
    n_groups = int(labels.max()) + 1
    prior = np.zeros((len(labels), n_groups), np.float32)
    prior[np.flatnonzero(labels >= 0), labels[labels >= 0]] = 1
    count = VoteCount(views)
    pictures = []
    for camera in spread_cameras(views.cameras.cameras, n_views):
        if should_stop():
            raise Cancelled("Stopped while searching for all objects; none was stored.")
        view = views.of(camera)
        picture = _group_picture(views, view, prior)
        if camera.photo in label_maps:
            segments = view.labels_from_photo(label_maps[camera.photo])
            snapped = picture.copy()
            for group in np.unique(picture[picture >= 0]):
                mask = picture == group
                snapped[snap_to_segments(mask, segments) & ~mask] = group
            picture = snapped
        count.add(view, picture[..., None] == np.arange(n_groups))
        pictures.append((camera.photo, picture))
    return count.membership(prior), pictures


def _group_picture(views: Views, view: View, memberships: Float32) -> Labels:
    """Return the group that contributes more than half of each pixel, [h, w]; -1 for none."""
    shares = views.scene.render(view.frame, channels=memberships).channels
    group = shares.argmax(axis=-1)
    return np.where((shares.max(axis=-1) > 0.5) & view.within, group, -1).astype(np.int32)
