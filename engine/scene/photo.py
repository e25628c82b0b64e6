"""Photos and photo sets, as all packages exchange them. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Photo:
    """A readable photo.

    Attributes
    ----------
    name : str
        Path relative to the photo folder, with forward slashes. It identifies the photo in all packages and files.
    width, height : int
        Size in pixels after EXIF rotation. Clicks, boxes, masks and rendered pictures refer to this frame.
    focal_px : float or None
        Focal length in these pixels from EXIF, None when the file does not state it.
    sha256 : str
        Hash of the file.
    mask, mask_sha256 : str or None
        Path of a picture that excludes pixels of the photo (see `engine.photos`), and its hash; None without a mask.
    """

    name: str
    width: int
    height: int
    focal_px: float | None
    sha256: str
    mask: str | None = None
    mask_sha256: str | None = None

    @property
    def hashes(self) -> list[str]:
        """Name and hash of the photo, and the hash of its mask if any. Results depend on these."""
        return [self.name, self.sha256, *([self.mask_sha256] if self.mask_sha256 else [])]


@dataclass(frozen=True)
class RejectedPhoto:
    """A file that is not used, with the reason as a sentence."""

    name: str
    reason: str


@dataclass(frozen=True)
class PhotoSet:
    """The photos of a folder ordered by name, and the files of the folder that are not used."""

    folder: Path
    photos: tuple[Photo, ...]
    rejected: tuple[RejectedPhoto, ...]

    @property
    def mask_files(self) -> dict[str, Path]:
        """Mask files by photo name, for the photos that have a mask."""
        return {photo.name: Path(photo.mask) for photo in self.photos if photo.mask is not None}
