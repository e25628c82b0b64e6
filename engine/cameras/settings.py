"""How camera poses are estimated. Defaults are written here and nowhere else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from ..settings import require

__all__ = ["CameraModel", "CameraSettings"]

CameraModel = Literal[
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE", "OPENCV_FISHEYE", "THIN_PRISM_FISHEYE",
]  # fmt: skip


@dataclass(frozen=True)
class CameraSettings:
    """What structure from motion reads; every field is part of the stage's key.

    Attributes
    ----------
    max_side : int
        Pixels. The photos are matched at this longest side.
    max_features : int
        SIFT features a photo. COLMAP stops after the octave that passes it and counts a second orientation extra, so
        up to 1.6 times as many are found.
    first_octave : int
        -1 looks at twice the resolution: twice the points and half the pose error of 0, at 4 times the time to
        detect. Against a 1,600-pixel reconstruction of 32 photos, mean camera position error relative to the
        distance: 0.05 % with -1, 0.11 % with 0.
    model : str
        COLMAP lens model that is fitted, one lens for all photos of equal size and EXIF focal length.
    exhaustive_up_to : int
        Photos. Up to this number every pair is matched; above it the pairs that a quick look at the largest features
        finds promising.
    neighbours : int
        Above `exhaustive_up_to`, the likeliest partners each photo is matched with at least.
    min_registered : int
        Photos that must find their place, at least 3.
    seed : int
        Of every random choice.
    threads : int
        0 takes all cores. Poses repeat exactly with 1, and to about 1e-6 of the scene's size with more.
    """

    max_side: int = 1000
    max_features: int = 2500
    first_octave: int = -1
    model: CameraModel = "SIMPLE_RADIAL"
    exhaustive_up_to: int = 16
    neighbours: int = 8
    min_registered: int = 3
    seed: int = 0
    threads: int = 0

    def __post_init__(self) -> None:
        require(self, "max_side", self.max_side >= 64, "at least 64")
        require(self, "max_features", self.max_features >= 100, "at least 100")
        require(self, "first_octave", self.first_octave in (-1, 0, 1), "-1, 0 or 1")
        require(self, "model", self.model in get_args(CameraModel), f"one of {', '.join(get_args(CameraModel))}")
        require(self, "exhaustive_up_to", self.exhaustive_up_to >= 2, "at least 2")
        require(self, "neighbours", self.neighbours >= 2, "at least 2")
        require(self, "min_registered", self.min_registered >= 3, "at least 3")
        require(self, "seed", self.seed >= 0, "at least 0")
        require(self, "threads", self.threads >= 0, "at least 0")
