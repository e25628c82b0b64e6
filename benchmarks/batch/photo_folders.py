"""Small photo folders of the museum room, and comparison of the projects that are made of them."""

from __future__ import annotations

from pathlib import Path

from ..security.kills_checks import scene_of
from ..security.kills_fixture import write_small_photos

_N_VIEWS = 48


def write_folders(folder: Path, count: int, n_photos: int) -> list[Path]:
    """Write `count` folders of neighbouring photos of the museum room, each beginning at another photo."""
    made = []
    for number in range(count):
        made.append(folder / f"scan_{number}")
        write_small_photos(made[-1], [(4 + 5 * number + i) % _N_VIEWS for i in range(n_photos)])
    return made


def same_scenes(first: Path, second: Path) -> list[str]:
    """Return the parts in which two projects differ: poses, label maps, Gaussians, objects; no times."""
    one, other = scene_of(first), scene_of(second)
    return sorted(name for name in one if one[name] != other.get(name))
