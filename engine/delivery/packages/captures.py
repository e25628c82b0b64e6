"""The EXIF facts of the photos, read from the photo folder when a record is made."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...core.errors import FormatError, PhotoError
from ...core.files import path_within, record_of
from ...photos import exif_facts
from ...project.folder import ProjectFolder


def photo_file(project: ProjectFolder, capture: dict[str, Any]) -> Path | None:
    """Return the photo of a capture, None where its folder does not hold the very file that was used."""
    folder = Path(str(project.get("photo_folder") or ""))
    try:
        path = path_within(folder, capture["name"])
        return path if path.is_file() and record_of(path)["sha256"] == capture["sha256"] else None
    except (FormatError, OSError):
        return None


def add_exif(project: ProjectFolder, described: dict[str, Any]) -> None:
    """Add ``exif`` to each capture of a record: its facts, or None with the reason in ``exif_missing``."""
    for capture in described["captures"]:
        path = photo_file(project, capture)
        if path is None:
            capture |= {"exif": None, "exif_missing": "The photo folder does not hold this file any more."}
            continue
        try:
            capture["exif"] = exif_facts(path)
        except PhotoError as error:
            capture |= {"exif": None, "exif_missing": str(error)}
