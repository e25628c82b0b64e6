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
    """

    name: str
    width: int
    height: int
    focal_px: float | None
    sha256: str


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
