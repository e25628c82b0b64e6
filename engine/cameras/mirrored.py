"""Photos that are mirror images of the others: selfie cameras and some programs store them so.

SIFT finds the same features in a mirror image, with mirrored descriptors, so no photo matches its mirrored neighbour.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..core.arrays import Float32, Floats
from ..core.errors import Cancelled
from ..core.events import StopCheck
from .colmap import pycolmap
from .features import largest_features
from .pairs import MIN_QUICK_MATCHES, quick_match_rows, quick_matches

_NEXT_PHOTOS = 3
"""Photos after each one, in the order of names, that it is compared with: usually its neighbours in space."""
_CLEARLY = 2.0
"""Mirrored matches for each plain one from which on a pair is mirrored. Symmetric objects give fewer than one.

chosen on: benchmarks/camera_health, the choosing half."""

_PIXELS = 4.0
"""Distance from its epipolar line up to which a mirrored match agrees: COLMAP's own in verification."""
_AGREEING, _MIN_AGREEING = 0.5, 13
"""Share and number of the mirrored matches of a link that one epipolar geometry explains at least. Chance explains up
to 11 of 14."""  # chosen on room_1, room_3, room_5, room_7, museum_room, banana16, sakharov_statue32


def mirrored_descriptors(descriptors: Float32) -> Float32:
    """Return the SIFT descriptors [N, 128] that the mirror image has at the same features.

    A descriptor has 4 x 4 cells of 8 directions, row by row, in the frame of the feature's main direction. Mirrored at
    that direction, the rows are reversed and each direction becomes its negative.
    """
    cells = descriptors.reshape(-1, 4, 4, 8)
    directions = (-np.arange(8)) % 8
    return np.ascontiguousarray(cells[:, ::-1][..., directions].reshape(-1, 128))


def mirrored_photos(database: Path, names: Sequence[str], *, should_stop: StopCheck) -> tuple[str, ...]:
    """Return the copies, by their names in the database, that match the others as mirror images only.

    Parameters
    ----------
    database : Path
        COLMAP's database with features.
    names : sequence of str
        All copies, in the order of the photos.

    Returns
    -------
    tuple of str
        Of the two sides that mirrored links separate, the one with fewer photos.

    Raises
    ------
    Cancelled
        When `should_stop` returned True.
    """
    features = largest_features(database, names)
    links: list[tuple[int, int, int, bool]] = []
    for i in range(len(names)):
        if should_stop():
            raise Cancelled("Stopped while comparing mirror images. The next run continues from here.")
        for j in range(i + 1, min(len(names), i + 1 + _NEXT_PHOTOS)):
            plain = quick_matches(features[i].descriptors, features[j].descriptors)
            rows = quick_match_rows(features[i].descriptors, mirrored_descriptors(features[j].descriptors))
            if len(rows) >= MIN_QUICK_MATCHES and len(rows) > _CLEARLY * plain:
                agreeing = agreeing_as_mirrored(features[i].positions[rows[:, 0]], features[j].positions[rows[:, 1]])
                if agreeing >= max(_MIN_AGREEING, _AGREEING * len(rows)):
                    links.append((agreeing, i, j, True))
            elif plain >= MIN_QUICK_MATCHES:
                links.append((plain, i, j, False))
    return tuple(names[index] for index in smaller_side(len(names), links))


def agreeing_as_mirrored(first: Floats, second: Floats) -> int:
    """Return how many of the matches at [M, 2] and [M, 2] one epipolar geometry explains, with `second` mirrored."""
    options = pycolmap.RANSACOptions()
    options.max_error = _PIXELS
    options.random_seed = 0
    flipped = second.astype(np.float64) * (-1.0, 1.0)
    found = pycolmap.estimate_fundamental_matrix(first.astype(np.float64), flipped, options)
    return 0 if found is None else int(found["num_inliers"])


def smaller_side(count: int, links: Sequence[tuple[int, int, int, bool]]) -> list[int]:
    """Return the photos that lie on the smaller side of the mirrored links.

    Parameters
    ----------
    count : int
        Number of photos.
    links : sequence of (int, int, int, bool)
        Strength, two photos, and whether one is mirrored. Strong links decide first: what a weaker one says against
        them, a symmetric building for example, does not count.
    """
    group = list(range(count))
    flipped = [False] * count
    for _, i, j, is_mirrored in sorted(links, key=lambda link: (-link[0], link[1:])):
        if group[i] == group[j]:
            continue
        change = flipped[i] ^ flipped[j] ^ is_mirrored
        joined = group[j]
        for index in range(count):
            if group[index] == joined:
                group[index] = group[i]
                flipped[index] ^= change
    found: list[int] = []
    for name in set(group):
        members = [index for index in range(count) if group[index] == name]
        turned = [index for index in members if flipped[index]]
        found += turned if 2 * len(turned) <= len(members) else [index for index in members if not flipped[index]]
    return sorted(found)
