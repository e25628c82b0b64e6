"""Reading of ``transforms.json`` as written by nerfstudio and instant-ngp and for the NeRF synthetic scenes.

The file has camera-to-world matrices with OpenGL axes (x right, y up, z backward). They are converted here to
world-to-camera matrices with x right, y down, z forward; the world frame and its unit stay as in the file.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import CameraError, FormatError
from ..core.files import optional, path_within, read_json
from ..scene import FISHEYE_LENS, MAX_COORDINATE, MAX_LENS_PARAMETER, MAX_PHOTO_SIDE, Lens, Photo
from .orientation import GivenCamera

_OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
_FISHEYE = (FISHEYE_LENS, "FISHEYE")
_PERSPECTIVE = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
_NUMBERS = (
    *("fl_x", "fl_y", "cx", "cy", "w", "h", "camera_angle_x", "camera_angle_y"),
    *("k1", "k2", "k3", "k4", "p1", "p2"),
)
_LENS_SCHEMA = {
    **{name: optional(float) for name in _NUMBERS},
    "camera_model": optional(str),
    "is_fisheye": optional((bool, int)),
}
_SCHEMA = {
    **_LENS_SCHEMA,
    "ply_file_path": optional((str, None)),
    "frames": [{**_LENS_SCHEMA, "file_path": str, "transform_matrix": [[float]]}],
}


def read_transforms_json(file: Path) -> dict[str, Any]:
    """Return the content of a ``transforms.json``.

    Raises
    ------
    FormatError
        When the file cannot be read, is not JSON or is not what the format demands.
    """
    advice = "Choose a transforms.json of nerfstudio or instant-ngp, or a COLMAP model."
    data: dict[str, Any] = read_json(file, _SCHEMA, advice=advice)
    return data


def read_transforms(file: Path) -> tuple[dict[str, dict[str, Any]], Path | None]:
    """Return the values of each frame by the name of its picture, and the point cloud, None without an existing one.

    Parameters
    ----------
    file : Path
        Its lens values (``fl_x``, ``fl_y`` or ``camera_angle_x`` in radians, ``cx``, ``cy``, ``w``, ``h``, ``k1`` to
        ``k4``, ``p1``, ``p2``) may be given for all frames or for each frame.

    Raises
    ------
    CameraError
        When the path of the point cloud leads out of the folder of `file`.
    FormatError
        When the file cannot be read, see `read_transforms_json`.
    """
    data = read_transforms_json(file)
    frames = {frame["file_path"]: {**data, **frame} for frame in data["frames"]}
    return frames, _cloud_file(file, data.get("ply_file_path"))


def frame_camera(values: dict[str, Any], name: str, photo: Photo, file: Path) -> GivenCamera:
    """Return the camera of the frame `name` with these values; raises `CameraError` when it is not one."""
    try:
        size = _size(values)
        # Checked now, so that the message names the frame.
        _lens(values, *(size or (photo.width, photo.height)))
        viewmat = _viewmat(values["transform_matrix"])
    except (ValueError, np.linalg.LinAlgError) as error:
        raise CameraError(f"The frame {name} in {file} is not a camera: {error}.") from error
    return GivenCamera(photo, name, viewmat, lambda w, h: _lens(values, w, h), size, np.zeros(0, np.int64))


def _cloud_file(file: Path, name: str | None) -> Path | None:
    if not name:
        return None
    try:
        cloud = path_within(file.parent, name)
    except FormatError as error:
        raise CameraError(
            f"`ply_file_path` in {file} leads out of its folder. Put the point cloud beside the file and correct the "
            "path."
        ) from error
    return cloud if cloud.is_file() else None


def _viewmat(rows: list[list[float]]) -> NDArray[np.float64]:
    # instant-ngp writes 4 rows, others leave out the last one.
    if len(rows) not in (3, 4) or any(len(row) != 4 or max(map(abs, row)) > MAX_COORDINATE for row in rows):
        raise ValueError("`transform_matrix` must be 4 rows of 4 finite numbers")
    matrix = np.array(rows, dtype=np.float64)
    rotation, center = matrix[:3, :3] @ _OPENCV_FROM_OPENGL[:3, :3], matrix[:3, 3]
    # instant-ngp stores rotations with few digits: use the nearest orthogonal matrix.
    left, _, right = np.linalg.svd(rotation)
    if not np.allclose(left @ right, rotation, atol=1e-2):
        raise ValueError("its rotation is scaled or skewed")
    if np.linalg.det(rotation) <= 0.0:
        raise ValueError("its rotation is mirrored")
    rotation = left @ right
    viewmat = np.eye(4)
    viewmat[:3, :3] = rotation.T
    viewmat[:3, 3] = -rotation.T @ center
    return viewmat


def _size(values: dict[str, Any]) -> tuple[int, int] | None:
    """Return width and height of a frame's picture; None when it does not say them."""
    if ("w" in values) != ("h" in values):
        raise ValueError("it has only one of `w` and `h`")
    if "w" not in values:
        return None
    width, height = float(values["w"]), float(values["h"])
    if not (1.0 <= width <= MAX_PHOTO_SIDE and 1.0 <= height <= MAX_PHOTO_SIDE):
        raise ValueError(f"its picture cannot have {width:g} x {height:g} pixels")
    return round(width), round(height)


def _lens(values: dict[str, Any], width: int, height: int) -> Lens:
    """Return the lens of a picture of this size."""
    if "fl_x" in values:
        fx = float(values["fl_x"])
    elif "camera_angle_x" in values:
        fx = _focal(width, values["camera_angle_x"])
    else:
        raise ValueError("it has neither `fl_x` nor `camera_angle_x`")
    if "fl_y" in values:
        fy = float(values["fl_y"])
    elif "fl_x" not in values and "camera_angle_y" in values:
        fy = _focal(height, values["camera_angle_y"])
    else:
        fy = fx
    k1, k2, k3, k4, p1, p2 = distortion = [float(values.get(key, 0.0)) for key in ("k1", "k2", "k3", "k4", "p1", "p2")]
    pinhole = (fx, fy, float(values.get("cx", 0.5 * width)), float(values.get("cy", 0.5 * height)))
    if not (fx > 0.0 and fy > 0.0 and all(abs(value) <= MAX_LENS_PARAMETER for value in (*pinhole, *distortion))):
        raise ValueError("its focal lengths must be positive and all lens values finite")
    model = str(values.get("camera_model", "OPENCV")).upper()
    if model in _FISHEYE or values.get("is_fisheye"):
        return Lens(FISHEYE_LENS, width, height, (*pinhole, k1, k2, k3, k4))
    if model not in _PERSPECTIVE:
        raise ValueError(f"the camera model {model} is not supported")
    if k4:
        raise ValueError("`k4` is supported for fisheye lenses only")
    if k3:
        return Lens("FULL_OPENCV", width, height, (*pinhole, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0))
    if not any((k1, k2, p1, p2)):
        return Lens("PINHOLE", width, height, pinhole)
    return Lens("OPENCV", width, height, (*pinhole, k1, k2, p1, p2))


def _focal(side: float, angle: float) -> float:
    """Return the focal length in pixels of a picture whose `side` covers `angle` radians."""
    if not 0.0 < angle < math.pi:
        raise ValueError("its angle of view must be above 0 and below 180 degrees")
    return 0.5 * side / math.tan(0.5 * float(angle))
