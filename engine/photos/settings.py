"""What decides which photos are used. Defaults are written here and nowhere else."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import require

__all__ = ["PhotoSettings"]


@dataclass(frozen=True)
class PhotoSettings:
    """Bounds below which a picture is listed as rejected instead of used.

    Attributes
    ----------
    min_side : int
        Pixels. A photo whose shorter side is below this is too small to match.
    blur_ratio : float
        A photo is blurred when its sharpness is below this share of the set's median sharpness; 0 keeps all.
        Measured on three real sets: the softest good photo stands at 0.66, Gaussian blur of 3 pixels at 800 px
        puts every photo below 0.19.
    max_blurred_share : float
        Never reject more than this share of the photos for blur (but one photo may always go): a set that is soft
        throughout is better than none.
    min_photos_for_blur : int
        Below this number of photos the median says little and none is rejected for blur.
    flat_share : float
        A photo is black (or white) when fewer than this share of its pixels lie above (or below) the last 3 % of
        the range.
    """

    min_side: int = 128
    blur_ratio: float = 0.3
    max_blurred_share: float = 0.1
    min_photos_for_blur: int = 5
    flat_share: float = 0.005

    def __post_init__(self) -> None:
        require(self, "min_side", self.min_side >= 1, "at least 1")
        require(self, "blur_ratio", 0.0 <= self.blur_ratio < 1.0, "at least 0 and below 1")
        require(self, "max_blurred_share", 0.0 <= self.max_blurred_share <= 0.5, "between 0 and 0.5")
        require(self, "min_photos_for_blur", self.min_photos_for_blur >= 3, "at least 3")
        require(self, "flat_share", 0.0 <= self.flat_share < 1.0, "at least 0 and below 1")
