"""Reading of ``transforms.json`` as written by nerfstudio and instant-ngp and for the NeRF synthetic scenes.

The file has camera-to-world matrices with OpenGL axes (x right, y up, z backward). They are converted here to
world-to-camera matrices with x right, y down, z forward; the world frame and its unit stay those of the file.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import CameraError
from ..scene import Camera, Photo, PhotoSet
from .reconstruction import is_scaled

__all__ = ["read_transforms"]

_OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
_FISHEYE = ("OPENCV_FISHEYE", "FISHEYE")
_PERSPECTIVE = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")


def read_transforms(
    file: Path, photo_set: PhotoSet, match: Callable[[Iterable[str], PhotoSet], dict[str, Photo]]
) -> tuple[list[Camera], Path | None]:
    """Return the cameras in the frame of `file`, and the path of its point cloud, None without an existing one.

    Parameters
    ----------
    file : Path
        Its lens values (``fl_x``, ``fl_y`` or ``camera_angle_x`` in radians, ``cx``, ``cy``, ``w``, ``h``, ``k1`` to
        ``k4``, ``p1``, ``p2``) may be given for all frames or for each frame.
    photo_set : PhotoSet
    match : callable
        Returns the photo of each file path, see `given.match_photos`.

    Raises
    ------
    CameraError
        When the file cannot be read or a frame in it is invalid.
    """
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        frames = {str(frame["file_path"]).replace("\\", "/").removeprefix("./"): frame for frame in data["frames"]}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        reason = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
        raise CameraError(
            f"{file} is not a transforms.json: {reason}. Choose one of nerfstudio or instant-ngp, or a COLMAP model."
        ) from error
    cameras = []
    for name, photo in match(frames, photo_set).items():
        try:
            cameras.append(_camera({**data, **frames[name]}, photo))
        except (KeyError, TypeError, ValueError, np.linalg.LinAlgError) as error:
            raise CameraError(f"The frame {name} in {file} is not a camera: {error}.") from error
    cloud = data.get("ply_file_path")
    cloud_file = file.parent / cloud if isinstance(cloud, str) else None
    return cameras, cloud_file if cloud_file is not None and cloud_file.is_file() else None


def _camera(values: dict[str, Any], photo: Photo) -> Camera:
    matrix = np.array(values["transform_matrix"], dtype=np.float64)
    if matrix.shape == (3, 4):
        matrix = np.vstack([matrix, (0.0, 0.0, 0.0, 1.0)])
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise ValueError("`transform_matrix` must be 4 rows of 4 finite numbers")
    rotation, center = matrix[:3, :3] @ _OPENCV_FROM_OPENGL[:3, :3], matrix[:3, 3]
    if np.linalg.det(rotation) <= 0.0:
        raise ValueError("its rotation is mirrored")
    # instant-ngp stores rotations with few digits: use the nearest orthogonal matrix.
    left, _, right = np.linalg.svd(rotation)
    if not np.allclose(left @ right, rotation, atol=1e-2):
        raise ValueError("its rotation is scaled or skewed")
    rotation = left @ right
    viewmat = np.eye(4)
    viewmat[:3, :3] = rotation.T
    viewmat[:3, 3] = -rotation.T @ center
    model, params = _lens(values, photo)
    return Camera(photo.name, photo.width, photo.height, model, params, viewmat)


def _lens(values: dict[str, Any], photo: Photo) -> tuple[str, tuple[float, ...]]:
    """Return COLMAP's model name and parameters in the photo's pixels."""
    width, height = float(values.get("w", photo.width)), float(values.get("h", photo.height))
    if not is_scaled((width, height), (photo.width, photo.height)):
        raise ValueError(
            f"its picture has {width:g} x {height:g} pixels, the photo {photo.width} x {photo.height}: it was made "
            "from rotated, cropped or other pictures"
        )
    sx, sy = photo.width / width, photo.height / height
    if "fl_x" in values:
        fx = float(values["fl_x"])
    elif "camera_angle_x" in values:
        fx = 0.5 * width / math.tan(0.5 * float(values["camera_angle_x"]))
    else:
        raise ValueError("it has neither `fl_x` nor `camera_angle_x`")
    if "fl_y" in values:
        fy = float(values["fl_y"])
    elif "fl_x" not in values and "camera_angle_y" in values:
        fy = 0.5 * height / math.tan(0.5 * float(values["camera_angle_y"]))
    else:
        fy = fx
    k1, k2, k3, k4, p1, p2 = (float(values.get(key, 0.0)) for key in ("k1", "k2", "k3", "k4", "p1", "p2"))
    pinhole = (fx * sx, fy * sy, float(values.get("cx", 0.5 * width)) * sx, float(values.get("cy", 0.5 * height)) * sy)
    if not (fx > 0.0 and fy > 0.0 and all(map(math.isfinite, (*pinhole, k1, k2, k3, k4, p1, p2)))):
        raise ValueError("its focal lengths must be positive and all lens values finite")
    model = str(values.get("camera_model", "OPENCV")).upper()
    if model in _FISHEYE or values.get("is_fisheye"):
        return "OPENCV_FISHEYE", (*pinhole, k1, k2, k3, k4)
    if model not in _PERSPECTIVE:
        raise ValueError(f"the camera model {model} is not supported")
    if k4:
        raise ValueError("`k4` is supported for fisheye lenses only")
    if k3:
        return "FULL_OPENCV", (*pinhole, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0)
    if not any((k1, k2, p1, p2)):
        return "PINHOLE", pinhole
    return "OPENCV", (*pinhole, k1, k2, p1, p2)
