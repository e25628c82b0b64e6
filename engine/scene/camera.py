"""The camera types every later room reads. NumPy only.

Conventions: COLMAP/OpenCV cameras (x right, y down, z forward); ``viewmat`` is world-to-camera; the centre of the
top left pixel is (0.5, 0.5). The world is the normalised upright one: right-handed, Z up, about unit size around 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Camera", "CameraSet", "PinholeCamera"]

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """One registered photo: its lens (distorted) and pose, in pixels of the original photo after EXIF rotation.

    Attributes
    ----------
    photo : str
        Name of the photo: its path relative to the photo folder.
    width, height : int
        Pixels of the original photo after EXIF rotation.
    model : str
        COLMAP camera model name, e.g. ``"SIMPLE_RADIAL"`` or ``"OPENCV"``.
    params : tuple of float
        Parameters in COLMAP's order for `model`, in original pixels.
    viewmat : array of shape [4, 4], float64
        World-to-camera.
    """

    photo: str
    width: int
    height: int
    model: str
    params: tuple[float, ...]
    viewmat: Float64

    @property
    def center(self) -> Float64:
        """Position of the camera in the world, shape [3]."""
        return -self.viewmat[:3, :3].T @ self.viewmat[:3, 3]


@dataclass(frozen=True)
class PinholeCamera:
    """An ideal camera without distortion, which is what the rasterizer renders.

    Attributes
    ----------
    viewmat : array of shape [4, 4], float64
        World-to-camera.
    K : array of shape [3, 3], float64
        Intrinsics in pixels.
    width, height : int
        Size of the picture in pixels.
    """

    viewmat: Float64
    K: Float64
    width: int
    height: int

    @property
    def center(self) -> Float64:
        """Position of the camera in the world, shape [3]."""
        return -self.viewmat[:3, :3].T @ self.viewmat[:3, 3]


@dataclass(frozen=True)
class CameraSet:
    """What the cameras room hands on.

    Attributes
    ----------
    cameras : tuple of Camera
        Registered photos, ordered by photo name.
    unregistered : tuple of str
        Photos that could not be placed.
    points : array of shape [P, 3], float32
        Sparse points in the normalised world.
    point_colors : array of shape [P, 3], uint8, sRGB
    reprojection_error : float
        Mean reprojection error of the sparse points in pixels of the pictures that were matched; NaN when unknown.
    original_from_world : array of shape [4, 4], float64
        Similarity (rotation, uniform scale, translation) from the normalised world to the frame of the poses as
        estimated or given.
    poses_given : bool
        True when the poses were read from the user's own model, not estimated here.
    """

    cameras: tuple[Camera, ...]
    unregistered: tuple[str, ...]
    points: NDArray[np.float32]
    point_colors: NDArray[np.uint8]
    reprojection_error: float
    original_from_world: Float64
    poses_given: bool
