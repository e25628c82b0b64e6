"""Recognise photos in which the background stands still while the object turns, as on a turntable.

A camera that does not move sees the background at the same pixels in all photos. COLMAP then finds the pose of the
camera relative to the background, which is the same for all photos, and the object's points contradict it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .colmap import pycolmap
from .colmap_calls import opened_database
from .features import SfmWorkspace

_STILL = 0.0015
"""Largest distance of a feature that stands still from its match, as a share of the longest side of the photo."""
_MIN_MATCHES = 15
"""Least number of verified matches of a pair that is judged, that of COLMAP."""
_MIN_STILL_SHARE = 0.5
"""Least share of the verified matches that stand still in a pair with a still background."""
_MIN_PAIRS_SHARE = 0.5
"""Least share of such pairs among all that are judged."""
_MIN_PAIRS = 3


@dataclass(frozen=True)
class StillBackground:
    """Pairs of photos with a background that stands still.

    Attributes
    ----------
    n_still, n_pairs : int
        Pairs in which most verified matches stand still, and all pairs with verified matches.
    moving_share : float
        Mean share of all matches of those pairs that do move.
    """

    n_still: int
    n_pairs: int
    moving_share: float

    @property
    def sentence(self) -> str:
        """The problem and what to do, in words."""
        if self.moving_share < 0.02:
            seen = "Neither the camera nor the object seems to move"
        else:
            seen = "The background stands still while the object moves, as on a turntable"
        return (
            f"{seen}: in {self.n_still} of {self.n_pairs} pairs of photos, most matches are at the same place in both. "
            "Leave the background out with --mask-background (in Blender: Mask Background), give masks of your own "
            "with --photo-masks (Masks), or photograph the object before a plain background."
        )


def still_background(workspace: SfmWorkspace) -> StillBackground | None:
    """Return how many pairs of photos have a still background; None where these are not the most.

    Parameters
    ----------
    workspace : SfmWorkspace
        Whose photos are matched.

    Raises
    ------
    CameraError, DiskError
        When the database cannot be read.
    """
    n_still, shares_moving, n_pairs = 0, [], 0
    with opened_database(workspace.database) as database:
        images = {image.image_id: workspace.copy_of(image.name) for image in database.read_all_images()}
        places = {number: database.read_keypoints(number)[:, :2] for number in images}
        for pair, geometry in zip(*database.read_two_view_geometries(), strict=True):
            first, second = pycolmap.pair_id_to_image_pair(pair)
            copies = images[first], images[second]
            matches = np.asarray(geometry.inlier_matches)
            if (copies[0].width, copies[0].height) != (copies[1].width, copies[1].height):
                continue
            if len(matches) < _MIN_MATCHES:
                continue
            n_pairs += 1
            limit = _STILL * max(copies[0].width, copies[0].height)
            if _share_within(places[first], places[second], matches, limit) < _MIN_STILL_SHARE:
                continue
            n_still += 1
            every = np.asarray(database.read_matches(first, second))
            shares_moving.append(1.0 - _share_within(places[first], places[second], every, 3.0 * limit))
    if n_still < max(_MIN_PAIRS, _MIN_PAIRS_SHARE * n_pairs):
        return None
    return StillBackground(n_still, n_pairs, float(np.mean(shares_moving)))


def _share_within(
    first: np.ndarray[tuple[int, ...], np.dtype[np.float32]],
    second: np.ndarray[tuple[int, ...], np.dtype[np.float32]],
    matches: np.ndarray[tuple[int, ...], np.dtype[np.uint32]],
    limit: float,
) -> float:
    """Return the share of the matches [M, 2] whose places are at a distance of at most `limit` pixels."""
    distances = np.linalg.norm(first[matches[:, 0]] - second[matches[:, 1]], axis=1)
    return float(np.mean(distances <= limit))
