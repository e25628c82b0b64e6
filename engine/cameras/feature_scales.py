"""How large things are in each photo, from the sizes of matched features: a first guess of zooms.

A feature that two photos share is larger in the photo with the longer lens, or in the nearer one. Sizes are measured
without any camera model, so they show zooms even where the mapping with a shared lens went wrong.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, eye_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve

from .colmap_calls import opened_database, verified_pairs

_MIN_MATCHES = 15
"""Verified matches from which on a pair counts: COLMAP's own bound."""
_SWEEPS = 20
_EXACT = 0.05
"""Residual of a pair, as a logarithm, below which its weight does not grow: features are measured to a few percent."""
_HELD = 1e-6
"""Weight that holds the mean of connected photos at 0; a pair has 15 and more."""
_DISTINCT = 1.1
"""Ratio of the scales of neighbouring groups from which on they are tried as lenses."""
_MIN_GROUP = 2
"""Photos of a group."""
SIZES_DIFFER = 1.2
"""Ratio of the scales of neighbouring photos from which on the photos fall into groups that show things in different
sizes. Walks with one lens have at most 1.14, with zooms of 1.6 and more 1.1 to 1.8."""
# chosen on museum_room, room_1, room_3, room_5, room_7, banana16, herz_jesus25, sakharov_statue32, boxes 80 to 87


def feature_sizes(keypoints: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the sizes [N] of COLMAP's keypoints [N, 4 or 6], in pixels."""
    # Columns: x, y and the feature's affine shape [[a11, a12], [a21, a22]], or x, y, scale, orientation.
    return np.hypot(keypoints[:, 2], keypoints[:, 4]) if keypoints.shape[1] >= 6 else keypoints[:, 2]


def relative_scales(database: Path) -> dict[int, float]:
    """Return how much larger things are in each photo than on average, as logarithms, by image id.

    Parameters
    ----------
    database : Path
        COLMAP's database with verified matches.

    Returns
    -------
    dict of int to float
        Values that explain the median ratios of all pairs best, by absolute differences. Photos that no pair connects
        have 0; where no link connects groups of photos, each group has a mean of 0.
    """
    ids, pairs = _size_ratios(database)
    return balanced_scales(ids, pairs)


def size_gap(database: Path) -> float:
    """Return how far apart photos that began with one lens fall into two groups by what they show in which size.

    Photos of two zooms do so whatever model is made of them.

    Parameters
    ----------
    database : Path
        COLMAP's database with verified matches.

    Returns
    -------
    float
        The largest of the groups' `largest_gap`, of those photos that the pairs connect with most others.
    """
    ids, pairs = _size_ratios(database)
    scales = balanced_scales(ids, pairs)
    connected = _most_connected(ids, pairs)
    with opened_database(database) as opened:
        folders = {image.image_id: image.name.split("/")[0] for image in opened.read_all_images()}
    groups: dict[str, list[float]] = {}
    for image_id in connected:
        groups.setdefault(folders[image_id], []).append(scales[image_id])
    return max((largest_gap(values) for values in groups.values()), default=1.0)


def photos_at_gap(database: Path, count: int) -> list[str]:
    """Return the names of at most `count` photos on both sides of the largest gap between the sizes, in their order.

    Half of them are those that match best across the gap, the others those that match best with one of these.

    Parameters
    ----------
    database : Path
        COLMAP's database with verified matches.
    """
    chosen = ids_at_gap(*_size_ratios(database), count)
    with opened_database(database) as opened:
        names = {image.image_id: image.name for image in opened.read_all_images()}
    return sorted(names[image_id] for image_id in chosen)


def ids_at_gap(ids: Sequence[int], pairs: Sequence[tuple[int, int, int, float]], count: int) -> set[int]:
    """Return the ids of `photos_at_gap`, from pairs (first, second, matches, ratio) as `balanced_scales` takes them."""
    scales = balanced_scales(ids, pairs)
    connected = sorted(_most_connected(ids, pairs), key=lambda image_id: (scales[image_id], image_id))
    steps = np.diff([scales[image_id] for image_id in connected])
    small = set(connected[: _MIN_GROUP + int(steps[_MIN_GROUP - 1 : len(steps) - _MIN_GROUP + 1].argmax())])
    links = sorted((-matches, a, b) for a, b, matches, _ in pairs if {a, b} <= set(connected))
    chosen: set[int] = set()
    for _, a, b in links:
        if (a in small) != (b in small) and len(chosen | {a, b}) <= count // 2:
            chosen |= {a, b}
    while len(chosen) < count:
        best = next(((a, b) for _, a, b in links if (a in chosen) != (b in chosen)), None)
        if best is None:
            break
        chosen |= set(best)
    return chosen


def largest_gap(scales: Sequence[float]) -> float:
    """Return the largest ratio between neighbours of the sorted `scales`, which are logarithms.

    At least two of them lie on each side of it; with fewer than four, it is 1.
    """
    if len(scales) < 2 * _MIN_GROUP:
        return 1.0
    steps = np.diff(np.sort(scales))
    return float(np.exp(steps[_MIN_GROUP - 1 : len(steps) - _MIN_GROUP + 1].max()))


def _parts(ids: Sequence[int], pairs: Sequence[tuple[int, int, int, float]]) -> NDArray[np.int32]:
    """Return for each id, [N], the number of its part, of those that `pairs` connect."""
    index = {image_id: number for number, image_id in enumerate(ids)}
    ends = np.array([(index[a], index[b]) for a, b, _, _ in pairs], np.intp).reshape(-1, 2)
    links = csr_array((np.ones(len(pairs)), (ends[:, 0], ends[:, 1])), shape=(len(ids), len(ids)))
    parts: NDArray[np.int32] = connected_components(links, directed=False)[1]
    return parts


def _most_connected(ids: Sequence[int], pairs: Sequence[tuple[int, int, int, float]]) -> list[int]:
    """Return the ids of the largest part that `pairs` connect."""
    parts = _parts(ids, pairs)
    return [ids[index] for index in np.flatnonzero(parts == np.bincount(parts).argmax()).tolist()]


def _size_ratios(database: Path) -> tuple[list[int], list[tuple[int, int, int, float]]]:
    """Return the image ids, and of each verified pair both ids, its matches and how much larger they are in the second.

    The ratio is a logarithm.
    """
    pairs: list[tuple[int, int, int, float]] = []
    with opened_database(database) as opened:
        ids = sorted(image.image_id for image in opened.read_all_images())
        sizes = {image_id: feature_sizes(np.asarray(opened.read_keypoints(image_id))) for image_id in ids}
        for a, b, count in verified_pairs(opened, _MIN_MATCHES):
            rows = np.asarray(opened.read_two_view_geometry(a, b).inlier_matches)
            ratio = float(np.median(np.log(sizes[b][rows[:, 1]] / sizes[a][rows[:, 0]])))
            pairs.append((a, b, count, ratio))
    return ids, pairs


def balanced_scales(ids: Sequence[int], pairs: Sequence[tuple[int, int, int, float]]) -> dict[int, float]:
    """Return values by id whose differences are the ratios (first, second, matches, ratio) of `pairs`."""
    column = {image_id: index for index, image_id in enumerate(ids)}
    rows = np.repeat(np.arange(len(pairs)), 2)
    columns = [column[image_id] for a, b, _, _ in pairs for image_id in (a, b)]
    differences = csr_array((np.tile([-1.0, 1.0], len(pairs)), (rows, columns)), shape=(len(pairs), len(ids)))
    ratios = np.array([ratio for *_, ratio in pairs])
    strength = np.sqrt([count for _, _, count, _ in pairs])
    weights = strength
    values = np.zeros(len(ids))
    held = _HELD * eye_array(len(ids), format="csr")
    part = _parts(ids, pairs)
    for _ in range(_SWEEPS):
        weighted = differences.T * weights**2
        values = spsolve(csc_array(weighted @ differences + held), weighted @ ratios)
        # Weights by the residuals make the sum of squares one of absolute values, which wrong pairs change little.
        weights = strength / np.sqrt(np.maximum(np.abs(ratios - differences @ values), _EXACT))
    # The mean of each part is 0. What holds it in the system leaves an error of rounding.
    values = values - (np.bincount(part, values) / np.bincount(part))[part]
    return {image_id: float(values[index]) for image_id, index in column.items()}


def scale_groups(scales: Mapping[int, float], count: int) -> list[tuple[float, list[int]]]:
    """Return `count` groups of photos of nearly equal scale.

    Parameters
    ----------
    scales : mapping of int to float
        Logarithms by image id.
    count : int
        2 or 3.

    Returns
    -------
    list of (float, list of int)
        The median scale and the members of each group, with the smallest sum of squares within; empty when there are
        too few photos or the groups differ by less than 10 %.
    """
    ids = sorted(scales, key=lambda image_id: (scales[image_id], image_id))
    values = np.array([scales[image_id] for image_id in ids])
    sums = np.concatenate([[0.0], np.cumsum(values)])
    squares = np.concatenate([[0.0], np.cumsum(values**2)])

    cuts = np.array(list(itertools.combinations(range(_MIN_GROUP, len(ids) - _MIN_GROUP + 1), count - 1)), np.intp)
    cuts = cuts.reshape(-1, count - 1)
    bounds = np.concatenate([np.zeros_like(cuts[:, :1]), cuts, np.full_like(cuts[:, :1], len(ids))], axis=1)
    bounds = bounds[(np.diff(bounds) >= _MIN_GROUP).all(axis=1)]
    if not len(bounds):
        return []
    spread = np.diff(squares[bounds]) - np.diff(sums[bounds]) ** 2 / np.diff(bounds)
    chosen = bounds[spread.sum(axis=1).argmin()].tolist()
    groups = [(float(np.median(values[a:b])), sorted(ids[a:b])) for a, b in itertools.pairwise(chosen)]
    steps = np.diff([scale for scale, _ in groups])
    return groups if (steps > np.log(_DISTINCT)).all() else []
