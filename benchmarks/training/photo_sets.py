"""The photo sets that training is compared on. Constants may be chosen on all of them: their figures are in sample."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from engine.core.errors import SettingsError

from ..places import ROOT
from ..rooms.keeping import unpack_kept

REAL_SETS = ("herz_jesus25", "meeting_place9", "banana16", "sakharov_statue32", "skull66")
"""Folders of ``GAUSSIAN_HERITAGE_DATA``."""
SCENES = ("museum_room", "store_room")
ROOMS = tuple(f"room_{number}" for number in range(1, 9))
NAMES = (*REAL_SETS, *SCENES, *ROOMS)


@dataclass(frozen=True)
class PhotoSetFolder:
    """A photo set.

    Attributes
    ----------
    name : str
    photos : Path
    project : Path or None
        Finished project whose cameras and masks are used; None where they are made.
    """

    name: str
    photos: Path
    project: Path | None = None


def photo_set(name: str) -> PhotoSetFolder:
    """Return a photo set by its name. A kept room is unpacked into ``out/kept`` at the first call.

    Raises
    ------
    SettingsError
        When there is no such set, or its photos are not on this computer.
    HeritageError
        As `unpack_room`.
    """
    if name in SCENES:
        folder = ROOT / "demo" / name
        return PhotoSetFolder(name, folder / "photos")
    if name in ROOMS:
        folder = ROOT / "out" / "kept" / name
        if not folder.exists():
            unpack_kept(name, folder)
        return PhotoSetFolder(name, folder / "photos", folder / "project")
    if name not in REAL_SETS:
        raise SettingsError(f"There is no photo set {name!r}, only {', '.join(NAMES)}.")
    data = os.environ.get("GAUSSIAN_HERITAGE_DATA")
    photos = Path(data or "") / name / "photos"
    if data is None or not photos.is_dir():
        raise SettingsError(
            f"The photos of {name} are not there. Set GAUSSIAN_HERITAGE_DATA to the folder that has them."
        )
    return PhotoSetFolder(name, photos)
