"""Reading and checking the photos of a folder."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .look import PhotoLook, look_at_photos, read_looks
    from .photo_masks import load_with_valid
    from .pixels import load_pixels
    from .reading import picture_files, read_photos

__all__ = [
    "PhotoLook",
    "load_pixels",
    "load_with_valid",
    "look_at_photos",
    "picture_files",
    "read_looks",
    "read_photos",
]

__getattr__ = lazy_exports(__name__, __file__)
