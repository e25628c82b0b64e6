"""File of a `PhotoSet` (JSON)."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from ..errors import FormatError
from ..files import is_inner_name, write_json
from .photo import Photo, PhotoSet, RejectedPhoto

__all__ = ["read_photo_set", "write_photo_set"]

_VERSION = 1


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
        When the file is missing, damaged or written by another version.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data["version"] != _VERSION:
            raise FormatError(
                f"{path} was written by another version of Gaussian Heritage. Use a new folder for the scene."
            )
        photos = tuple(Photo(**photo) for photo in data["photos"])
        for photo in photos:
            if not is_inner_name(photo.name) or not (photo.mask is None or isinstance(photo.mask, str)):
                raise ValueError(f"{photo.name!r} is not the name of a photo")
        return PhotoSet(
            folder=Path(data["folder"]),
            photos=photos,
            rejected=tuple(RejectedPhoto(**photo) for photo in data["rejected"]),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FormatError(
            f"The photo list {path} cannot be read: {error}. Delete it and run `reconstruct` again."
        ) from error
