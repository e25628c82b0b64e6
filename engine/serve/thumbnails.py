"""Small pictures of objects for the list: the part of a photo that shows the object."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ..core.child_process import run_in_child
from ..core.files import delete_derived, object_file
from ..project.objects import EVIDENCE_FILE, RECORD_FILE, read_record
from .library import NotFound, WebProject
from .small_photos import LARGE_SIDE, write_jpeg

_Box: TypeAlias = tuple[float, float, float, float]
"""Left and top edge, width and height in pixels."""

_MAX_MEMORY, _MAX_SECONDS = 8 << 30, 120.0
"""Bounds of the child process that looks for an object in the photos."""
_SIDE = 160
"""Pixels of the longest side of the picture."""
_MARGIN = 0.2
"""Share of the object's size that is shown around it."""


def object_thumbnail(project: WebProject, object_id: str) -> Path:
    """Return a JPEG of an object, cut out of the photo that it was found in.

    The background, and what was made by hand, were found in no photo: they are cut out of the one that shows them best.

    Raises
    ------
    NotFound
        When no photo shows it, or the photo was deleted.
    HeritageError
        When a part of the project is damaged.
    """
    record_file = object_file(project.project, object_id, RECORD_FILE)
    mask_file = object_file(project.project, object_id, EVIDENCE_FILE)
    record = read_record(record_file)
    key = record_file.stat().st_mtime_ns
    file = project.cache / f"thumbnail-{object_id}-{key:x}.jpg"
    if not file.exists():
        project.cache.mkdir(exist_ok=True)
        for old in project.cache.glob(f"thumbnail-{object_id}-*.jpg"):
            delete_derived(project.cache, old.name)
        if record.evidence and mask_file.is_file():
            photo = project.photo(str(record.evidence[0].get("photo")))
            _write(photo, lambda width, height: _box_of_mask(mask_file, width, height), file)
        else:
            name, edges = _best_place(project, object_id, record.threshold)
            _write(project.photo(name), lambda width, height: _box_of_edges(edges, width, height), file)
    return file


def _best_place(project: WebProject, object_id: str, threshold: float) -> tuple[str, list[float]]:
    found = run_in_child(
        "serve.shown_places:best_place",
        {
            "project": str(project.project),
            "object_id": object_id,
            "threshold": threshold,
            "photos": project.photo_names(),
        },
        max_memory=_MAX_MEMORY,
        max_seconds=_MAX_SECONDS,
        what="looking for the object in the photos",
    )
    if found is None:
        raise NotFound("There is no picture of the object.")
    name, edges = found
    return name, edges


def _box_of_mask(mask_file: Path, width: int, height: int) -> _Box:
    import cv2

    from ..photos import load_pixels

    mask = load_pixels(mask_file, max_side=LARGE_SIDE)[..., 0]
    # A mask of few pixels may vanish when it is reduced, but no mean over an area with one of them is 0.
    inside = cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA) > 0
    if not inside.any():
        raise NotFound("There is no picture of the object.")
    x, y, w, h = cv2.boundingRect(inside.astype(np.uint8))
    return x, y, w, h


def _box_of_edges(edges: list[float], width: int, height: int) -> _Box:
    left, top, right, bottom = edges
    return left * width, top * height, (right - left) * width, (bottom - top) * height


def _write(photo: Path, box_in: Callable[[int, int], _Box], file: Path) -> None:
    """Write the part of a photo around the box that `box_in` returns for its width and height."""
    import cv2

    from ..photos import load_pixels

    pixels = load_pixels(photo, max_side=LARGE_SIDE)
    height, width = pixels.shape[:2]
    x, y, w, h = box_in(width, height)
    half = max(w, h) * (1 + 2 * _MARGIN) / 2
    # A square, moved into the photo where it sticks out.
    side = min(max(round(2 * half), 1), height, width)
    left = int(np.clip(round(x + w / 2 - side / 2), 0, width - side))
    top = int(np.clip(round(y + h / 2 - side / 2), 0, height - side))
    cut = pixels[top : top + side, left : left + side]
    scale = min(1.0, _SIDE / side)
    small = cv2.resize(cut, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    write_jpeg(small, file)
