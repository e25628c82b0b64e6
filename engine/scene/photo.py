"""The photo types every later room reads. Standard library only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

__all__ = ["Photo", "PhotoSet", "RejectedPhoto"]


@dataclass(frozen=True)
class Photo:
    """One readable photo.

    Attributes
    ----------
    name : str
        Path relative to the photo folder, with forward slashes: the photo's identity in every room and file.
    width, height : int
        Pixels after EXIF rotation: the frame of every click, box, mask and rendered picture that a user sees.
    focal_px : float or None
        Focal length in those pixels from EXIF, None when the file does not say.
    sha256 : str
        Of the file as it lies on disk.
    mask, mask_sha256 : str or None
        Picture that says which of its pixels count (see `photo_masks`), as a path, and its hash; None for none.
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
        """Name and hash of the photo, and its mask's hash where it has one: what results depend on."""
        return [self.name, self.sha256, *([self.mask_sha256] if self.mask_sha256 else [])]


@dataclass(frozen=True)
class RejectedPhoto:
    """A file that is not used, with the reason in one sentence."""

    name: str
    reason: str


@dataclass(frozen=True)
class PhotoSet:
    """What the photos room hands on: `photos` ordered by name, all inside `folder`, and what was `rejected`."""

    folder: Path
    photos: tuple[Photo, ...]
    rejected: tuple[RejectedPhoto, ...]

    @property
    def mask_files(self) -> dict[str, Path]:
        """Files of the photos' masks by the photos' names; photos without one are left out."""
        return {photo.name: Path(photo.mask) for photo in self.photos if photo.mask is not None}
