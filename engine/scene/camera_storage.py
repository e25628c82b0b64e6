"""Files of a `CameraSet`: ``cameras.json`` and ``points.npz`` in a folder.

Units and axes are those of `engine.scene.camera`: lens parameters in pixels of the photos, world-to-camera matrices.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from ..errors import FormatError
from ..files import atomic_write, is_inner_name, write_json
from .camera import Camera, CameraSet

__all__ = ["read_camera_set", "write_camera_set"]

_VERSION = 1
_CAMERAS, _POINTS = "cameras.json", "points.npz"


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
        When a file is missing, damaged or written by another version.
    """
    if not (path / _CAMERAS).is_file():
        raise FormatError(f"{path / _CAMERAS} is missing. Run `reconstruct` first.")
    try:
        data = json.loads((path / _CAMERAS).read_text(encoding="utf-8"))
        if data["version"] != _VERSION:
            raise FormatError(
                f"{path} was written by another version of Gaussian Heritage. Use a new folder for the scene."
            )
        with np.load(path / _POINTS, allow_pickle=False) as arrays:
            points, colors = arrays["points"], arrays["colors"]
        error = data["reprojection_error"]
        return CameraSet(
            cameras=tuple(
                Camera(
                    photo=_photo_name(camera["photo"]),
                    width=int(camera["width"]),
                    height=int(camera["height"]),
                    model=camera["model"],
                    params=tuple(float(value) for value in camera["params"]),
                    viewmat=np.array(camera["viewmat"], dtype=np.float64).reshape(4, 4),
                )
                for camera in data["cameras"]
            ),
            unregistered=tuple(data["unregistered"]),
            points=points.astype(np.float32, copy=False).reshape(-1, 3),
            point_colors=colors.astype(np.uint8, copy=False).reshape(-1, 3),
            reprojection_error=math.nan if error is None else float(error),
            original_from_world=np.array(data["original_from_world"], dtype=np.float64).reshape(4, 4),
            poses_given=bool(data["poses_given"]),
        )
    except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
        raise FormatError(
            f"The cameras in {path} cannot be read: {error}. Delete the folder and run `reconstruct` again."
        ) from error


def _photo_name(name: object) -> str:
    """Return the name of a photo. It names files of the project, so that it must not lead out of a folder."""
    if not isinstance(name, str) or not is_inner_name(name):
        raise ValueError(f"{name!r} is not the name of a photo")
    return name
