"""Settings that decide which photos are used, and which frames of a video."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..core.settings import require
from ..scene import is_fisheye

PHOTO_SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".heic", ".heif")
"""Of files that count as photos where they are uploaded or chosen. The engine reads a folder by what its files are."""
VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm")
"""Files that count as videos."""


@dataclass(frozen=True)
class PhotoSettings:
    """Criteria for rejecting a photo.

    Attributes
    ----------
    min_side : int
        Smallest allowed length of the shorter side in pixels. Smaller photos have too few features to match.
    blur_ratio : float
        A photo is blurred when its sharpness is below this share of the set's median sharpness; 0 keeps all photos.
        See docs/design_notes/photos.md for measured values.
    max_blurred_share : float
        Largest share of the photos that may be rejected for blur; one photo may always be rejected. A set in which all
        photos are soft is still used.
    min_photos_for_blur : int
        With fewer photos the median is not meaningful, and no photo is rejected for blur.
    flat_share : float
        A photo is black (or white) when fewer than this share of its pixels are outside of the darkest (or brightest)
        3 % of the range.
    keep_fisheye : bool
        Whether round fisheye pictures are used: only a fisheye lens model describes them.
    """

    min_side: int = 128
    blur_ratio: float = 0.3
    max_blurred_share: float = 0.1
    min_photos_for_blur: int = 5
    flat_share: float = 0.005
    keep_fisheye: bool = False

    def __post_init__(self) -> None:
        require(self, "min_side", self.min_side >= 1, "at least 1")
        require(self, "blur_ratio", 0.0 <= self.blur_ratio < 1.0, "at least 0 and below 1")
        require(self, "max_blurred_share", 0.0 <= self.max_blurred_share <= 0.5, "between 0 and 0.5")
        require(self, "min_photos_for_blur", self.min_photos_for_blur >= 3, "at least 3")
        require(self, "flat_share", 0.0 <= self.flat_share < 1.0, "at least 0 and below 1")

    def for_lens(self, model: str, *, is_given: bool) -> PhotoSettings:
        """Return these settings for cameras of COLMAP's lens model `model`, or for given ones of any model."""
        return replace(self, keep_fisheye=self.keep_fisheye or is_given or is_fisheye(model))


@dataclass(frozen=True)
class VideoSettings:
    """Which frames of a video become photos.

    Attributes
    ----------
    min_frames, max_frames : int
        Fewest and most photos that a video gives.
    motion_between : float
        Camera motion between two photos, as a share of the width of the picture. Not chosen on data: neighbours then
        share nine tenths of what they show.
    looks_per_second : float
        Frames per second of which motion and sharpness are measured.
    density : float
        How many times as many photos are taken as by the other settings. Neighbours then share more.
    """

    min_frames: int = 8
    max_frames: int = 150
    motion_between: float = 0.1
    looks_per_second: float = 10.0
    density: float = 1.0

    def __post_init__(self) -> None:
        require(self, "min_frames", self.min_frames >= 3, "at least 3")
        require(self, "max_frames", self.max_frames >= self.min_frames, "at least min_frames")
        require(self, "motion_between", self.motion_between > 0.0, "above 0")
        require(self, "looks_per_second", self.looks_per_second > 0.0, "above 0")
        require(self, "density", 0.25 <= self.density <= 8.0, "from 0.25 to 8")
