"""Files of a `CameraSet`: ``cameras.json`` and ``points.npz`` in a folder.

Units and axes are those of `engine.scene.camera`: lens parameters in pixels of the photos, world-to-camera matrices.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FormatError
from ..core.files import ArraySpec, atomic_write, read_arrays, read_versioned, write_json
from .camera import MAX_COORDINATE, Camera, CameraSet, similarity_scale
from .camera_health import HEALTH_COLOURS, CameraHealth
from .lens import lens_problem
from .photo_storage import photo_name, size_problem
from .rotations import is_rotation

_VERSION = 1
_CAMERAS, _POINTS = "cameras.json", "points.npz"
_SCHEMA = {
    "poses_given": bool,
    "reprojection_error": (float, None),
    "original_from_world": [[float]],
    "unregistered": [str],
    # Null where nothing could be checked.
    "health": ({"colour": str, "cause": str, "sentence": str, "refuted": [str]}, None),
    "cameras": [{"photo": str, "width": int, "height": int, "model": str, "params": [float], "viewmat": [[float]]}],
}
_ARRAYS = {"points": ArraySpec("float32", ("n", 3), finite=True), "colors": ArraySpec("uint8", ("n", 3))}
_RIGID_TOLERANCE = 1e-4
"""Largest error of the products of a rotation's rows. Some programs write poses as float32 or with 6 digits; the engine
and Blender invert poses by transposition, which this error changes by less than a pixel in 10,000."""


def write_camera_set(path: Path, camera_set: CameraSet) -> None:
    """Write `camera_set` to the folder `path`, each file atomically, ``cameras.json`` last.

    Raises
    ------
    DiskError
        When a file cannot be written.
    """
    with atomic_write(path / _POINTS) as stream:
        np.savez(stream, points=camera_set.points, colors=camera_set.point_colors)
    error = camera_set.reprojection_error
    write_json(
        path / _CAMERAS,
        {
            "version": _VERSION,
            "convention": "COLMAP cameras in original pixels; viewmat is world-to-camera; x right, y down, z forward",
            "poses_given": camera_set.poses_given,
            # JSON has no NaN.
            "reprojection_error": error if math.isfinite(error) else None,
            "original_from_world": camera_set.original_from_world.tolist(),
            "unregistered": list(camera_set.unregistered),
            "health": None if camera_set.health is None else dataclasses.asdict(camera_set.health),
            "cameras": [
                {
                    "photo": camera.photo,
                    "width": camera.width,
                    "height": camera.height,
                    "model": camera.model,
                    "params": list(camera.params),
                    "viewmat": camera.viewmat.tolist(),
                }
                for camera in camera_set.cameras
            ],
        },
    )


def read_camera_set(path: Path) -> CameraSet:
    """Return the `CameraSet` that `write_camera_set` wrote to the folder `path`, floats bit for bit.

    Raises
    ------
    FormatError
        When a file is missing, damaged or written by another version, or a camera cannot exist: a photo without
        pixels, a lens that `lens_problem` refuses, a pose that is not a rotation and a translation.
    """
    file = path / _CAMERAS
    if not file.is_file():
        raise FormatError(f"{file} is missing. Run `reconstruct` first.")
    advice = f"Delete the folder {path} and run `reconstruct` again."
    data = read_versioned(file, _SCHEMA, version=_VERSION, advice=advice)
    arrays = read_arrays(path / _POINTS, _ARRAYS, advice=advice)
    error = data["reprojection_error"]
    try:
        return CameraSet(
            cameras=_cameras(data["cameras"]),
            unregistered=tuple(map(photo_name, data["unregistered"])),
            points=arrays["points"],
            point_colors=arrays["colors"],
            reprojection_error=math.nan if error is None else float(error),
            original_from_world=_similarity(data["original_from_world"]),
            poses_given=data["poses_given"],
            health=_health(data["health"]),
        )
    except ValueError as problem:
        raise FormatError(f"{file} cannot be read: {problem}. {advice}") from problem


def _health(entry: dict[str, Any] | None) -> CameraHealth | None:
    """Return the finding of an entry; raises `ValueError` for a colour that does not exist."""
    if entry is None:
        return None
    if entry["colour"] not in HEALTH_COLOURS:
        raise ValueError(f"`health.colour` is {entry['colour']!r}, not one of {', '.join(HEALTH_COLOURS)}")
    return CameraHealth(entry["colour"], entry["cause"], entry["sentence"], tuple(map(photo_name, entry["refuted"])))


def _cameras(entries: list[dict[str, Any]]) -> tuple[Camera, ...]:
    """Return the cameras of `entries`; raises `ValueError` for one that cannot exist, or two of one photo."""
    cameras = {}
    for entry in entries:
        name = photo_name(entry["photo"])
        if name in cameras:
            raise ValueError(f"{name} has two cameras")
        params = tuple(float(value) for value in entry["params"])
        camera = Camera(name, entry["width"], entry["height"], entry["model"], params, _matrix(entry["viewmat"]))
        if problem := camera_problem(camera):
            raise ValueError(f"the camera of {name} cannot be used, because {problem}")
        cameras[name] = camera
    return tuple(cameras.values())


def camera_problem(camera: Camera) -> str | None:
    """Return why `camera` cannot be used, as a clause for a message; None for a usable one.

    Its photo must have pixels, its lens be one that `lens_problem` accepts, and its pose a rotation and a translation.
    `read_camera_set` refuses other cameras, so whatever makes cameras must not write them.
    """
    return size_problem(camera.width, camera.height) or lens_problem(camera.lens) or _pose_problem(camera.viewmat)


def _pose_problem(viewmat: NDArray[np.float64]) -> str | None:
    # Written so that NaN fails.
    if not np.abs(viewmat).max() <= MAX_COORDINATE:
        return "its position is not finite or is too large"
    return None if _is_rigid(viewmat) else "its pose is not a rotation and a translation"


def _similarity(rows: list[Any]) -> NDArray[np.float64]:
    """Return a rotation, uniform scale and translation; raises `ValueError` for another matrix."""
    matrix = _matrix(rows)
    scale = similarity_scale(matrix)
    rigid = matrix.copy()
    rigid[:3, :3] /= scale if scale > 0 else 1.0
    if not _is_rigid(rigid):
        raise ValueError("`original_from_world` is not a rotation, a scale and a translation")
    return matrix


def _matrix(rows: list[Any]) -> NDArray[np.float64]:
    if len(rows) != 4 or any(len(row) != 4 for row in rows):
        raise ValueError("a matrix does not have 4 rows of 4 numbers")
    matrix = np.array(rows, dtype=np.float64)
    if np.abs(matrix).max() > MAX_COORDINATE:
        raise ValueError("a number of a matrix is too large")
    return matrix


def _is_rigid(matrix: NDArray[np.float64]) -> bool:
    return is_rotation(matrix[:3, :3], tolerance=_RIGID_TOLERANCE) and bool((matrix[3] == (0, 0, 0, 1)).all())
