"""Small pictures of objects for the list: the part of a photo that shows the object."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..core.files import delete_derived, object_file
from ..project.objects import RECORD_FILE, read_record
from .library import NotFound, WebProject
from .small_photos import write_jpeg

__all__ = ["object_thumbnail"]

_MASK = "seed.png"
"""Mask of the object in the photo that it was found in, which `engine.objects` stores."""
_PHOTO_SIDE, _SIDE = 1600, 160
"""Pixels of the longest side of the photo that is cut, and of the picture."""
_MARGIN = 0.2
"""Share of the object's size that is shown around it."""


def object_thumbnail(project: WebProject, object_id: str) -> Path:
    """Return a JPEG of an object, cut out of the photo that it was found in.

    Raises
    ------
    NotFound
        When it was found in no photo, as the background, or the photo was deleted.
    HeritageError
        When a part of the project is damaged.
    """
    record_file = object_file(project.project, object_id, RECORD_FILE)
    mask_file = object_file(project.project, object_id, _MASK)
    evidence = read_record(record_file).evidence
    if not evidence or not mask_file.is_file():
        raise NotFound("There is no picture of the object.")
    photo = project.photo(str(evidence[0].get("photo")))
    key = record_file.stat().st_mtime_ns
    file = project.cache / f"thumbnail-{object_id}-{key:x}.jpg"
    if not file.exists():
        project.cache.mkdir(exist_ok=True)
        for old in project.cache.glob(f"thumbnail-{object_id}-*.jpg"):
            delete_derived(project.cache, old.name)
        _write(photo, mask_file, file)
    return file


def _write(photo: Path, mask_file: Path, file: Path) -> None:
    import cv2

    from ..photos import load_pixels

    pixels = load_pixels(photo, max_side=_PHOTO_SIDE)
    height, width = pixels.shape[:2]
    mask = load_pixels(mask_file, max_side=_PHOTO_SIDE)[..., 0]
    # A mask of few pixels may vanish when it is reduced, but no mean over an area with one of them is 0.
    inside = cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA) > 0
    if not inside.any():
        raise NotFound("There is no picture of the object.")
    x, y, w, h = cv2.boundingRect(inside.astype(np.uint8))
    half = max(w, h) * (1 + 2 * _MARGIN) / 2
    # A square, moved into the photo where it sticks out.
    side = min(round(2 * half), height, width)
    left = int(np.clip(round(x + w / 2 - side / 2), 0, width - side))
    top = int(np.clip(round(y + h / 2 - side / 2), 0, height - side))
    cut = pixels[top : top + side, left : left + side]
    scale = min(1.0, _SIDE / side)
    small = cv2.resize(cut, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    write_jpeg(small, file)
