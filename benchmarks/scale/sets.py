"""Photo sets of known and of unknown positions: parts of the building, the museum room, and real sets."""

from __future__ import annotations

import json
import shutil
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image

from engine.core.arrays import Float64
from engine.core.system import usable_cores
from engine.photos import read_photos
from engine.scene import PhotoSet

from ..places import ROOT
from ..training.photo_sets import photo_set
from .building import Building

_SEED = 0
_MUSEUM = ROOT / "demo" / "museum_room"
_PHOTOS_PER_TASK = 12


@dataclass(frozen=True)
class SizedSet:
    """Photos, and the true positions [3] by the names of the photos; none where they are unknown."""

    photos: PhotoSet
    positions: dict[str, Float64] = field(default_factory=dict)


def set_of(name: str, work: Path) -> SizedSet:
    """Return ``building_N``, ``museum_room``, or a set of the folder that ``GAUSSIAN_HERITAGE_DATA`` names.

    Parameters
    ----------
    name : str
    work : Path
        Folder in which photos of the building that are missing are made.
    """
    if name.startswith("building_"):
        return _building(int(name.removeprefix("building_")), work)
    if name == "museum_room":
        views = json.loads((_MUSEUM / "truth" / "cameras.json").read_text(encoding="utf-8"))["photos"]
        found = {view["file"]: _position(np.array(view["world_to_camera"], float)) for view in views}
        return SizedSet(read_photos(_MUSEUM / "photos"), found)
    return SizedSet(read_photos(photo_set(name).photos))


def _building(count: int, work: Path) -> SizedSet:
    rendered, folder = work / "photos", work / f"building_{count}"
    missing = [index for index in range(count) if not _photo(rendered, index).is_file()]
    tasks = [missing[start : start + _PHOTOS_PER_TASK] for start in range(0, len(missing), _PHOTOS_PER_TASK)]
    for needed in (rendered, folder):
        needed.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(len(usable_cores())) as pool:
        list(pool.map(_make, tasks, [rendered] * len(tasks)))
    for index in range(count):
        if not _photo(folder, index).is_file():  # another process may be reading it
            unfinished = _photo(folder, index).with_suffix(".unfinished")
            shutil.copyfile(_photo(rendered, index), unfinished)
            unfinished.replace(_photo(folder, index))
    cameras = Building(_SEED).cameras(count)
    positions = {_photo(folder, index).name: _position(camera) for index, camera in enumerate(cameras)}
    return SizedSet(read_photos(folder), positions)


def _photo(folder: Path, index: int) -> Path:
    return folder / f"{index:04d}.jpg"


def _make(indices: list[int], folder: Path) -> None:
    building = Building(_SEED)
    cameras = building.cameras(indices[-1] + 1)
    for index in indices:
        unfinished = _photo(folder, index).with_suffix(".unfinished")
        Image.fromarray(building.picture(cameras[index])).save(unfinished, "JPEG", quality=95)
        unfinished.replace(_photo(folder, index))


def _position(viewmat: Float64) -> Float64:
    return np.asarray(-viewmat[:3, :3].T @ viewmat[:3, 3])
