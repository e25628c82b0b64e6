"""Read and check the photos of a folder, their masks, and their statistics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .capture_facts import exif_facts
    from .inspection import PhotoStatistics, inspect_photos, read_photo_statistics
    from .kinds import SUFFIXES, VIDEO, kind_of_file, live_photo_of
    from .loading import load_pixels, load_with_valid, stored_orientation
    from .photo_masks import mask_files, with_masks
    from .pixels import MAX_PIXELS
    from .reading import file_listing, picture_files, read_photos
    from .video import extract_frames, is_video

__getattr__ = lazy_exports(__name__, __file__)
