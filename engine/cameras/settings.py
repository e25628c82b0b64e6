"""Settings of camera estimation and their defaults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..core.settings import require, require_choices

CameraModel = Literal[
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE", "OPENCV_FISHEYE", "THIN_PRISM_FISHEYE",
]  # fmt: skip

FEWEST_PHOTOS = 3
"""Photos without which there is no scene: two do not tell a wrong match from a right one."""


@dataclass(frozen=True)
class CameraSettings:
    """Settings of structure from motion. Every field is part of the stage key.

    See docs/design_notes/cameras.md for the measurements behind the defaults.

    Attributes
    ----------
    max_side : int
        Longest side of the photos for matching, in pixels. Larger photos are scaled down.
    max_features : int
        Target number of SIFT features per photo; COLMAP finds up to 1.6 times as many.
    first_octave : {-1, 0, 1}
        First octave of SIFT detection. -1 detects at twice the resolution: about twice the points and half the pose
        error of 0, and 4 times the detection time.
    model : str
        COLMAP lens model to fit, with one lens for all photos of equal size and EXIF focal length.
    exhaustive_up_to : int
        Largest number of photos for which every pair is matched. For more photos, pairs are selected by quick matching
        of their largest features.
    neighbours : int
        Minimum number of partners of a photo when pairs are selected.
    min_registered : int
        Minimum number of photos that must be placed, at least `FEWEST_PHOTOS`.
    seed : int
        Random seed.
    threads : int
        Number of threads for features and matches, 0 for all cores. Poses and points do not depend on it.
    """

    max_side: int = 1000
    max_features: int = 2500
    first_octave: Literal[-1, 0, 1] = -1
    model: CameraModel = "SIMPLE_RADIAL"
    exhaustive_up_to: int = 16
    neighbours: int = 8
    min_registered: int = FEWEST_PHOTOS
    seed: int = 0
    threads: int = 0

    def __post_init__(self) -> None:
        require(self, "max_side", self.max_side >= 64, "at least 64")
        require(self, "max_features", self.max_features >= 100, "at least 100")
        require_choices(self)
        require(self, "exhaustive_up_to", self.exhaustive_up_to >= 2, "at least 2")
        require(self, "neighbours", self.neighbours >= 2, "at least 2")
        require(self, "min_registered", self.min_registered >= FEWEST_PHOTOS, f"at least {FEWEST_PHOTOS}")
        require(self, "seed", self.seed >= 0, "at least 0")
        require(self, "threads", self.threads >= 0, "at least 0")
