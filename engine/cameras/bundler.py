"""Cameras and points of Bundler files (``bundle.out``, version 0.3), as RealityCapture and other programs export them.

A camera has a focal length in pixels, two radial coefficients, and world-to-camera with x right, y up, z backward; the
principal point is the centre of the picture. The pictures' names are the lines of a list in the same folder.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import CameraError, FormatError
from ..core.files import read_bytes, read_text
from ..scene import MAX_COORDINATE, MAX_LENS_PARAMETER, is_rotation
from .model_reading import write_model_arrays

_ADVICE = "Export it again with the list of its pictures, or export a COLMAP model."
_MAX_BYTES = 128 << 20
_MAX_POINTS = 5_000_000
_OPENGL = np.diag([1.0, -1.0, -1.0])
_CAMERA_NUMBERS, _VIEW_NUMBERS = 15, 4


def bundler_in_child(source: str, target: str, what: str) -> dict[str, Any]:
    """Write points and world-to-camera matrices of a Bundler file to `target`; return names and lenses of its cameras.

    Parameters
    ----------
    source, target : str
        The Bundler file, and the file for arrays.
    what : str
        For messages.

    Raises
    ------
    CameraError
        When the file is damaged, or no list names its pictures.
    """
    file = Path(source)
    words = read_bytes(file, max_bytes=_MAX_BYTES, advice=_ADVICE).split(b"\n", 1)[-1].split()
    try:
        names = _names(file, int(words[0]))
        return _read(words, names, Path(target))
    except (ValueError, IndexError, OverflowError) as error:
        why = "it ends too early" if isinstance(error, IndexError) else error
        raise CameraError(f"{what} cannot be used: {why}. {_ADVICE}") from error


def _names(file: Path, count: int) -> list[str]:
    """Return the names of the pictures from the list of a Bundler file; raises `ValueError` without one."""
    own = file.with_suffix(".list.txt"), file.with_suffix(".txt"), file.with_name("list.txt")
    for path in dict.fromkeys((*own, *sorted(file.parent.glob("*.txt")))):
        if path.is_file() and path != file:
            try:
                lines = [line for line in read_text(path, advice=_ADVICE).splitlines() if line.strip()]
            except FormatError:
                continue
            if len(lines) == count:
                return [_name(line) for line in lines]
    raise ValueError(f"no text file beside it lists the names of its {count} pictures")


def _name(line: str) -> str:
    """Return the name in a line of the list, which may be followed by a zero and a focal length."""
    head, *rest = line.rsplit(None, 2)
    is_focal = len(rest) == 2 and rest[0] == "0" and rest[1].replace(".", "", 1).isdigit()
    return head if is_focal else line.strip()


def _read(words: list[bytes], names: list[str], target: Path) -> dict[str, Any]:
    n_cameras, n_points = int(words[0]), int(words[1])
    if not 0 <= n_points <= _MAX_POINTS:
        raise ValueError(f"it cannot have {n_points} points")
    at = 2
    images: list[tuple[str, int, str]] = []
    lenses: list[dict[str, float]] = []
    viewmats: list[NDArray[np.float64]] = []
    number_of: dict[int, int] = {}
    for camera in range(n_cameras):
        values = _numbers(words, at, _CAMERA_NUMBERS)
        at += _CAMERA_NUMBERS
        if not values[0] > 0.0:
            continue  # not placed
        rotation, translation = _OPENGL @ values[3:12].reshape(3, 3), _OPENGL @ values[12:]
        if not is_rotation(rotation):
            raise ValueError(f"the rotation of {names[camera]} is scaled, skewed or mirrored")
        if np.abs(values[:3]).max() > MAX_LENS_PARAMETER or np.abs(translation).max() > MAX_COORDINATE:
            raise ValueError(f"the camera of {names[camera]} has numbers that are too large")
        left, _, right = np.linalg.svd(rotation)
        viewmat = np.eye(4)
        viewmat[:3, :3], viewmat[:3, 3] = left @ right, translation
        number_of[camera] = len(images)
        images.append((names[camera], len(images), ""))
        lenses.append({"f": values[0], "k1": values[1], "k2": values[2]})
        viewmats.append(viewmat)
    positions, colors = np.empty((n_points, 3)), np.empty((n_points, 3), np.uint8)
    seen: list[list[int]] = [[] for _ in images]
    for point in range(n_points):
        values = _numbers(words, at, 6)
        positions[point], colors[point] = values[:3], np.clip(values[3:], 0, 255)
        n_views = int(words[at + 6])
        if n_views < 0:
            raise ValueError(f"a point cannot have {n_views} views")
        at += 7
        for view in itertools.islice(range(n_views), n_cameras):
            number = number_of.get(int(words[at + _VIEW_NUMBERS * view]))
            if number is not None:
                seen[number].append(point)
        at += _VIEW_NUMBERS * n_views
    counts = [len(one) for one in seen]
    shown = np.array([point for one in seen for point in one], np.int64)
    write_model_arrays(target, positions, colors, {"viewmats": np.array(viewmats).reshape(-1, 4, 4), "seen": shown})
    return {"images": images, "lenses": lenses, "seen": counts}


def _numbers(words: list[bytes], at: int, count: int) -> NDArray[np.float64]:
    part = words[at : at + count]
    if len(part) < count:
        raise IndexError
    values = np.array([float(word) for word in part])
    if not np.isfinite(values).all():
        raise ValueError("a number is not finite")
    return values
