"""File of a `PhotoSet` (JSON)."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..core.errors import FormatError
from ..core.files import optional, problem_of_inner_name, read_versioned, write_json
from .photo import Photo, PhotoSet, RejectedPhoto

_VERSION = 1
_PHOTO = {
    "name": str,
    "width": int,
    "height": int,
    "focal_px": (float, None),
    "sha256": str,
    "mask": optional((str, None)),
    "mask_sha256": optional((str, None)),
}
_SCHEMA = {"folder": str, "photos": [_PHOTO], "rejected": [{"name": str, "reason": str}]}
MAX_PHOTO_SIDE = 100_000
"""Pixels. Larger than any photo, and small enough that its pixels can be counted in 64 bits."""


def write_photo_set(path: Path, photo_set: PhotoSet) -> None:
    """Write `photo_set` to the JSON file `path` atomically.

    Raises
    ------
    DiskError
        When the file cannot be written.
    """
    write_json(
        path,
        {
            "version": _VERSION,
            "folder": str(photo_set.folder),
            "photos": [asdict(photo) for photo in photo_set.photos],
            "rejected": [asdict(photo) for photo in photo_set.rejected],
        },
    )


def read_photo_set(path: Path) -> PhotoSet:
    """Return the `PhotoSet` that `write_photo_set` wrote to `path`.

    Raises
    ------
    FormatError
        When the file is missing, damaged or written by another version, or a photo has an impossible name or size.
    """
    advice = "Delete it and run `reconstruct` again."
    data = read_versioned(path, _SCHEMA, version=_VERSION, advice=advice)
    try:
        return PhotoSet(
            folder=_path(data["folder"]),
            photos=tuple(map(_photo, data["photos"])),
            rejected=tuple(RejectedPhoto(photo["name"], photo["reason"]) for photo in data["rejected"]),
        )
    except ValueError as error:
        raise FormatError(f"{path} cannot be read: {error}. {advice}") from error


def photo_name(name: str) -> str:
    """Return `name`; raises `ValueError` when it cannot be a photo's: it names files, so it must not lead out."""
    problem = problem_of_inner_name(name)
    if problem is not None:
        raise ValueError(f"{name[:200]!r} is not the name of a photo: it {problem}")
    return name


def size_problem(width: int, height: int) -> str | None:
    """Return why a photo cannot have this size, as a clause for a message; None for a usable one."""
    usable = all(1 <= side <= MAX_PHOTO_SIDE for side in (width, height))
    return None if usable else f"it cannot have {width} x {height} pixels"


def _photo(entry: dict[str, Any]) -> Photo:
    name, focal, mask = photo_name(entry["name"]), entry["focal_px"], entry.get("mask")
    problem = size_problem(entry["width"], entry["height"])
    if problem or (focal is not None and focal <= 0):
        raise ValueError(f"the photo {name} cannot be used, because {problem or 'its focal length must be above 0'}")
    if mask is not None:
        _path(mask)
    return Photo(
        name, entry["width"], entry["height"], focal, entry["sha256"], mask=mask, mask_sha256=entry.get("mask_sha256")
    )


def _path(text: str) -> Path:
    if "\0" in text:
        raise ValueError("a path has a null character")
    return Path(text)
