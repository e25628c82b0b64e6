"""The photo sets that training is compared on. Constants may be chosen on all of them: their figures are in sample."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from engine.core.errors import SettingsError

ROOT = Path(__file__).resolve().parents[2]

REAL_SETS = ("herz_jesus25", "meeting_place9", "banana16", "sakharov_statue32", "skull66")
"""Folders of ``GAUSSIAN_HERITAGE_DATA``."""
SCENES = ("museum_room", "store_room")
ROOMS = tuple(f"room_{number}" for number in range(1, 9))
NAMES = (*REAL_SETS, *SCENES, *ROOMS)

GAUSSIANS_OF_ROOMS = 15_000
"""Gaussians of a random room, as many as those of gsplat that `benchmarks.training.reference` names."""


@dataclass(frozen=True)
class PhotoSetFolder:
    """A photo set.

    Attributes
    ----------
    name : str
    photos : Path
    cameras : Path or None
        COLMAP model of the true cameras; None where cameras are estimated.
    truth : Path or None
        Ground truth of the objects.
    max_gaussians : int or None
        None for the number of the preset.
    """

    name: str
    photos: Path
    cameras: Path | None = None
    truth: Path | None = None
    max_gaussians: int | None = None


def photo_set(name: str) -> PhotoSetFolder:
    """Return a photo set by its name.

    Raises
    ------
    SettingsError
        When there is no such set, or its photos are not on this computer.
    """
    if name in SCENES:
        folder = ROOT / "demo" / name
        return PhotoSetFolder(name, folder / "photos", truth=folder / "truth")
    if name in ROOMS:
        folder = ROOT / "out" / "rooms" / name
        if not (folder / "cameras").is_dir():
            raise SettingsError(f"{name} is not rendered. Run `python -m benchmarks.rooms render {name}` first.")
        return PhotoSetFolder(name, folder / "photos", folder / "cameras", folder / "truth", GAUSSIANS_OF_ROOMS)
    if name not in REAL_SETS:
        raise SettingsError(f"There is no photo set {name!r}, only {', '.join(NAMES)}.")
    data = os.environ.get("GAUSSIAN_HERITAGE_DATA")
    photos = Path(data or "") / name / "photos"
    if data is None or not photos.is_dir():
        raise SettingsError(
            f"The photos of {name} are not there. Set GAUSSIAN_HERITAGE_DATA to the folder that has them."
        )
    return PhotoSetFolder(name, photos)
