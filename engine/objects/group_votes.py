"""What each photo's camera sees of a scene's groups, and how its pixels vote on which group a Gaussian belongs to."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..errors import Cancelled
from ..events import StopCheck
from .lifting import snap_to_segments
from .views import View, Views, spread_cameras

__all__ = ["group_picture", "vote_for_groups"]

Float32 = NDArray[np.float32]
Labels = NDArray[np.int32]

_CHANNELS = 60
"""Groups rendered, or voted on, at once."""


def group_picture(views: Views, view: View, labels: Labels, count: int) -> Labels:
    """Return the group that most of each pixel of `view` shows, int32 [h, w]; -1 where groups cover less than half.

    Parameters
    ----------
    views : Views
    view : View
    labels : array of shape [N], int32
        Group of each Gaussian, -1 for none.
    count : int
        Groups.
    """
    best = np.full(view.within.shape, -1, np.int32)
    most, total = np.zeros(best.shape, np.float32), np.zeros(best.shape, np.float32)
    for first in range(0, count, _CHANNELS):
        numbers = np.arange(first, min(first + _CHANNELS, count))
        shares = views.scene.render(view.frame, channels=(labels[:, None] == numbers).astype(np.float32)).channels
        largest = shares.max(axis=-1)
        best = np.where(largest > most, first + shares.argmax(axis=-1), best).astype(np.int32)
        most, total = np.maximum(most, largest), total + shares.sum(axis=-1)
    return np.where((total > 0.5) & view.within, best, -1).astype(np.int32)


def vote_for_groups(
    views: Views,
    labels: Labels,
    label_maps: Mapping[str, Labels],
    *,
    n_views: int,
    should_stop: StopCheck,
) -> tuple[Float32, list[tuple[str, Labels]]]:
    """Let the views vote on all groups at once.

    Parameters
    ----------
    views : Views
    labels : array of shape [N], int32
        As from `engine.objects.hierarchy.Hierarchy.apart`.
    label_maps : mapping of str to int32 array
        SAM label maps by photo: groups take the outline of the segments that they fill.
    n_views : int
        At most.
    should_stop : callable

    Returns
    -------
    array of shape [N, K], float32
        Membership of each Gaussian in each of K groups, in [0, 1].
    list of (str, int32 array of shape [h, w])
        What each view saw: the photo and its pixels' groups, -1 for none.

    Raises
    ------
    Cancelled
        When `should_stop` says so.
    """
    count = int(labels.max()) + 1
    single = np.zeros((len(labels), count), np.float32)
    single[np.flatnonzero(labels >= 0), labels[labels >= 0]] = 1
    inside, seen = np.zeros((len(labels), count), np.float32), np.zeros((len(labels), 1), np.float32)
    pictures = []
    for camera in spread_cameras(views.cameras.cameras, n_views):
        if should_stop():
            raise Cancelled("Stopped while looking at all objects; none was stored.")
        view = views.of(camera)
        picture = group_picture(views, view, labels, count)
        if camera.photo in label_maps:
            segments = view.labels_from_photo(label_maps[camera.photo])
            snapped = picture.copy()
            for group in np.unique(picture[picture >= 0]):
                mask = picture == group
                snapped[snap_to_segments(mask, segments) & ~mask] = group
            picture = snapped
        for first in range(0, count, _CHANNELS):
            numbers = np.arange(first, min(first + _CHANNELS, count))
            inside[:, numbers] += views.scene.votes(view.frame, (picture[..., None] == numbers).astype(np.float32))
        seen += views.scene.votes(view.frame, view.within[..., None].astype(np.float32))
        pictures.append((camera.photo, picture))
    # As in `refine_by_votes`, what was known counts as one pixel.
    return ((inside + single) / (seen + 1)).astype(np.float32), pictures
