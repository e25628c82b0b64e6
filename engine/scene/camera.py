"""Cameras with and without lens distortion, as all packages exchange them. NumPy only.

Conventions: camera axes are COLMAP's and OpenCV's (x right, y down, z forward); ``viewmat`` is world-to-camera; the
centre of the top left pixel is (0.5, 0.5). The world is the normalised one: right-handed, Z up, near the origin, with
cameras about one unit from it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float64
from .camera_health import CameraHealth

MAX_COORDINATE = 1e15
"""Largest coordinate, and entry of a matrix. Georeferenced scenes have 1e7; beyond 1e19, squares overflow float32."""
_NEAREST = 1e-6
"""Smallest depth of a projected point, world units."""


class Lens(NamedTuple):
    """The lens of a `Camera` without its photo and pose, which can be hashed. The fields are those of `Camera`."""

    model: str
    width: int
    height: int
    params: tuple[float, ...]


@dataclass(frozen=True)
class Camera:
    """Lens, with distortion, and pose of a photo, in pixels of the original photo after EXIF rotation.

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
    def lens(self) -> Lens:
        """Lens of the camera."""
        return Lens(self.model, self.width, self.height, self.params)

    @property
    def center(self) -> Float64:
        """Position of the camera in the world, shape [3]."""
        return -self.viewmat[:3, :3].T @ self.viewmat[:3, 3]


@dataclass(frozen=True)
class PinholeCamera:
    """An ideal camera without distortion, as the rasterizer needs it.

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

    def project(self, points: NDArray[np.floating]) -> tuple[NDArray[np.intp], Float64, Float64]:
        """Return which of `points`, [P, 3], lie in the picture, with their pixels [M, 2] and depths [M]."""
        local = points @ self.viewmat[:3, :3].T + self.viewmat[:3, 3]
        front = np.flatnonzero(local[:, 2] > _NEAREST)
        homogeneous = local[front] @ self.K.T
        x, y = homogeneous[:, 0] / homogeneous[:, 2], homogeneous[:, 1] / homogeneous[:, 2]
        inside = np.flatnonzero((x >= 0) & (x < self.width) & (y >= 0) & (y < self.height))
        return front[inside], np.column_stack([x[inside], y[inside]]), local[front[inside], 2]

    def places(self, rows: NDArray[np.intp], columns: NDArray[np.intp], depths: NDArray[np.floating]) -> Float64:
        """Return the places, [P, 3], that pixels show at depths along the view axis; all parameters are [P]."""
        rays = np.column_stack([columns + 0.5, rows + 0.5, np.ones(len(rows))]) @ np.linalg.inv(self.K).T
        places: Float64 = (rays * depths[:, None] - self.viewmat[:3, 3]) @ self.viewmat[:3, :3]
        return places

    def part(self, left: int, top: int, width: int, height: int) -> PinholeCamera:
        """Return the camera of a part of the picture, given in pixels."""
        K = self.K - np.array([[0, 0, left], [0, 0, top], [0, 0, 0]])
        return replace(self, K=K, width=width, height=height)

    def resized(self, width: int, height: int) -> PinholeCamera:
        """Return the camera of the same picture in another size, in pixels."""
        factors = np.array([width / self.width, height / self.height, 1.0])
        return replace(self, K=self.K * factors[:, None], width=width, height=height)

    def scaled(self, scale: float) -> PinholeCamera:
        """Return the camera of the same picture at this scale, rounded to whole pixels."""
        return self.resized(max(1, round(self.width * scale)), max(1, round(self.height * scale)))

    def reduced(self, max_side: int) -> PinholeCamera:
        """Return the camera of the same picture with at most `max_side` pixels along its longest side."""
        return self.scaled(min(1.0, max_side / max(self.width, self.height)))


@dataclass(frozen=True)
class CameraSet:
    """The cameras of a photo set and the sparse points found with them.

    Attributes
    ----------
    cameras : tuple of Camera
        Registered photos, ordered by photo name.
    unregistered : tuple of str
        Photos without a camera.
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
    health : CameraHealth or None
        What the photos say against the cameras; None where nothing was checked.
    """

    cameras: tuple[Camera, ...]
    unregistered: tuple[str, ...]
    points: NDArray[np.float32]
    point_colors: NDArray[np.uint8]
    reprojection_error: float
    original_from_world: Float64
    poses_given: bool
    health: CameraHealth | None = None

    @property
    def by_photo(self) -> dict[str, Camera]:
        """The cameras by the names of their photos."""
        return {camera.photo: camera for camera in self.cameras}


def similarity_scale(matrix: NDArray[np.floating]) -> float:
    """Return the factor by which a similarity, [4, 4] or [3, 4], scales lengths."""
    return float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
