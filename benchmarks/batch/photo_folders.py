"""Small photo folders of the museum room, and comparison of the projects that are made of them."""

from __future__ import annotations

from pathlib import Path

from PIL import Image

from ..places import ROOT
from ..security.kills_checks import scene_of

_ROOM = ROOT / "demo" / "museum_room" / "photos"
_N_VIEWS = 48
_SIZE = (384, 288)


def write_folders(folder: Path, count: int, n_photos: int) -> list[Path]:
    """Write `count` folders of neighbouring photos of the museum room, each beginning at another photo."""
    made = []
    for number in range(count):
        photos = folder / f"scan_{number}"
        photos.mkdir(parents=True)
        for i in range(n_photos):
            name = f"view_{(4 + 5 * number + i) % _N_VIEWS:02}.jpg"
            with Image.open(_ROOM / name) as picture:
                picture.resize(_SIZE, Image.Resampling.LANCZOS).save(photos / name, quality=95)
        made.append(photos)
    return made


def same_scenes(first: Path, second: Path) -> list[str]:
    """Return the parts in which two projects differ: poses, label maps, Gaussians, objects; no times."""
    one, other = scene_of(first), scene_of(second)
    return sorted(name for name in one if one[name] != other.get(name))
