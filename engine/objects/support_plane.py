"""Support planes: versions of an object cut off where it meets its support, e.g. an exhibit on a plinth.

SAM and the features often merge the base of an object with its support. Their shapes differ: the figure widens abruptly
where the support begins. See docs/design_notes/objects.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..masks import mask_iou
from .hierarchy import Hierarchy
from .selection import HALF, with_members

__all__ = ["SupportedVersion", "UpperPart", "cut_at_support_planes", "upper_parts"]

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_N_SLICES = 24  # chosen on museum_room, store_room
"""Horizontal slices that a figure is divided into."""

_MIN_SLICE_POINTS = 15  # chosen on museum_room, store_room
"""Mean number of points in a slice below which fewer slices are used."""

_DIRECTIONS = np.stack([np.cos(np.arange(8) * np.pi / 8), np.sin(np.arange(8) * np.pi / 8)])  # by definition
"""Horizontal directions along which the width of a slice is measured."""

MIN_WIDENING = 1.25  # chosen on museum_room, store_room
"""Smallest ratio of a slice's width to that of the slice above at which a figure is cut."""

MAX_CUTS = 6  # chosen on museum_room, store_room
"""Largest number of cuts of one figure. A goblet on a plinth widens at its bowl, its base and the plinth."""

_SUPPORT_WIDTH = 1.1  # chosen on museum_room, store_room
"""Width, relative to the part above, beyond which a point belongs to the support."""

_TOP_LAYER = 0.25  # chosen on museum_room, store_room
"""Thickness of the layer that contains the support's top, as a share of a slice."""

_MIN_SUPPORT_POINTS = 10  # chosen on museum_room, store_room
"""Smallest number of points of a support."""

_MIN_GROUP_COVER = 0.85  # chosen on museum_room, store_room
"""Share of the object that a group around it must contain."""

_MAX_GROUP_SIZE = 6.0  # chosen on museum_room, store_room
"""Largest number of Gaussians in a group around an object, relative to the object."""

_MIN_VERSION_SIZE, _MAX_VERSION_SIZE = 0.15, 2.0  # chosen on museum_room, store_room
"""Number of Gaussians in a version, relative to the object. The object may have been found with its whole plinth."""

SAME_VERSION_IOU = 0.9  # chosen on museum_room, store_room
"""IoU above which two versions are the same."""

_MIN_OBJECT_COVER = 0.95  # chosen on museum_room, store_room
"""Share of the object that a version with its base must contain."""

_MAX_BASE_HEIGHT = 0.3  # chosen on museum_room, store_room
"""Largest height of a base relative to the object's. What reaches farther down is not its base."""


@dataclass(frozen=True)
class UpperPart:
    """The part of a figure above a height.

    Attributes
    ----------
    members : bool array of shape [N]
    above_support : bool
        Whether the figure is wider directly below the part than anywhere in it. Then the part ends at a support plane.
        It is False for the bowl of a goblet, which is wider than the stem below.
    """

    members: Mask
    above_support: bool


@dataclass(frozen=True)
class SupportedVersion:
    """A version of an object that ends at a support plane.

    Attributes
    ----------
    membership : array of shape [N], float32
    adds_base : bool
        Whether it contains nearly all of the object and a base below it that ends at a support plane, while the object
        itself does not end at one.
    """

    membership: Float32
    adds_base: bool


def cut_at_support_planes(means: Float32, membership: Float32, hierarchy: Hierarchy) -> list[SupportedVersion]:
    """Return versions of an object, cut at the support planes of the object and of the groups around it.

    Parameters
    ----------
    means : array of shape [N, 3], float32
        Z is up.
    membership : array of shape [N], float32
        The object; a Gaussian belongs from 0.5 on.
    hierarchy : Hierarchy
        Groups of the scene.

    Returns
    -------
    list of SupportedVersion
        They differ from the object and from each other.
    """
    members = membership >= HALF
    count = int(members.sum())
    groups = (hierarchy.members(number) for number in range(len(hierarchy.groups)))
    figures = [
        group | members
        for group in groups
        if (group & members).sum() >= _MIN_GROUP_COVER * count and group.sum() <= _MAX_GROUP_SIZE * count
    ]
    parts = [part for figure in (members, *figures) for part in upper_parts(means, figure)]
    has_base = any(part.above_support and mask_iou(part.members, members) > SAME_VERSION_IOU for part in parts)
    low, high = np.percentile(means[members, 2], [1, 99]) if count else (0.0, 0.0)
    kept = [members]
    versions: list[SupportedVersion] = []
    # Of two similar parts, the one that is known to end at a support plane comes first and is kept.
    for part in sorted(parts, key=lambda part: not part.above_support):
        size = int(part.members.sum())
        fits = _MIN_VERSION_SIZE * count <= size <= _MAX_VERSION_SIZE * count
        if fits and all(mask_iou(part.members, other) <= SAME_VERSION_IOU for other in kept):
            kept.append(part.members)
            larger = size > count and (part.members & members).sum() >= _MIN_OBJECT_COVER * count
            near = np.percentile(means[part.members, 2], 1) >= low - _MAX_BASE_HEIGHT * (high - low)
            adds_base = bool(part.above_support and larger and near and not has_base)
            versions.append(SupportedVersion(with_members(membership, part.members), adds_base))
    return versions


def upper_parts(means: Float32, members: Mask) -> list[UpperPart]:
    """Return the parts of a figure above each height where it widens abruptly on the way down.

    Parameters
    ----------
    means : array of shape [N, 3], float32
        Z is up.
    members : bool array of shape [N]
        The figure.

    Returns
    -------
    list of UpperPart
        At most `MAX_CUTS`, the most abrupt widening first.

    Notes
    -----
    The figure is divided into 24 slices. The width of a slice is the distance from the 5th to the 95th percentile of
    its points, averaged over eight directions. A slice may be thicker than a base, so the height of the cut is that of
    the support's top within the slice.
    """
    points = means[members]
    count = min(_N_SLICES, len(points) // _MIN_SLICE_POINTS)
    if count < 2:
        return []
    low, high = np.percentile(points[:, 2], [1, 99])
    edges = np.linspace(low, high, count + 1)
    widths = _slice_widths(points, edges)
    ratios = np.divide(widths[:-1], widths[1:], out=np.zeros(count - 1), where=widths[1:] > 0)
    abrupt = [i for i in np.argsort(-ratios, kind="stable")[:MAX_CUTS] if ratios[i] >= MIN_WIDENING]
    parts = []
    for i in abrupt:
        top = _support_top(points, edges, i)
        above_support = top is not None and widths[i] > widths[i + 1 :].max()
        cut = edges[i + 1] if top is None else top
        parts.append(UpperPart(members & (means[:, 2] > cut), bool(above_support)))
    return parts


def _support_top(points: Float32, edges: NDArray[np.floating], wide: int) -> float | None:
    """Return the height of the support's top in slice `wide`, which is wider than the slice above.

    It is the upper end of the thin layer with most of the points that extend beyond everything above the slice. None if
    there are too few of them.
    """
    projected = points[:, :2] @ _DIRECTIONS
    low, high = np.percentile(projected[points[:, 2] > edges[wide + 1]], [5, 95], axis=0)
    beyond = (np.abs(projected - (low + high) / 2) > _SUPPORT_WIDTH * (high - low) / 2).any(axis=1)
    step = edges[1] - edges[0]
    near = (points[:, 2] > edges[wide] - step) & (points[:, 2] < edges[wide + 1] + step)
    heights = np.sort(points[beyond & near, 2])
    if len(heights) < _MIN_SUPPORT_POINTS:
        return None
    ends = np.searchsorted(heights, heights + _TOP_LAYER * step)
    return float(heights[np.argmax(ends - np.arange(len(heights)))] + _TOP_LAYER * step)


def _slice_widths(points: Float32, edges: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the width of each slice between two heights; 0 for a slice with fewer than two points."""
    slices = np.clip(np.searchsorted(edges, points[:, 2]) - 1, 0, len(edges) - 2)
    widths = np.zeros(len(edges) - 1)
    for i in range(len(widths)):
        projected = points[slices == i, :2] @ _DIRECTIONS
        if len(projected) > 1:
            low, high = np.percentile(projected, [5, 95], axis=0)
            widths[i] = (high - low).mean()
    return widths
