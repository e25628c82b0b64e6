"""From a place in the window to a pixel of the photo and back, while looking through the photo's camera. No bpy.

Blender's cameras look along -Z with Y up and have no lens distortion; a photo's pixel has all of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..engine.errors import CameraError
from ..engine.scene import Camera, photo_pixels

__all__ = ["FLIP", "View", "photo_pixel", "require_same_place"]

Float64 = NDArray[np.float64]
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""Between COLMAP's camera axes and Blender's, both ways."""
_MOST_TURN, _MOST_SHIFT = 1e-3, 1e-3
"""Radians, and scene units: a hand that moves a camera moves it further, float32 less."""


@dataclass(frozen=True)
class View:
    """A region of the window that shows what a camera sees.

    Attributes
    ----------
    width, height : int
        Of the region in pixels.
    window_from_world : array of shape [4, 4], float64
        Blender's ``RegionView3D.perspective_matrix``: homogeneous, -1 to 1 across the region, Y up.
    world_from_camera : array of shape [4, 4], float64
        ``matrix_world`` of the camera.
    """

    width: int
    height: int
    window_from_world: Float64
    world_from_camera: Float64

    def direction(self, x: float, y: float) -> tuple[float, float]:
        """Return the direction (see `lens`) seen at a place of the region, in pixels from its lower left corner."""
        u, v = 2.0 * x / self.width - 1.0, 2.0 * y / self.height - 1.0
        rows = self.window_from_world
        # Both planes hold the line of sight; unlike a point unprojected at some depth, they need no inverse.
        across, upright = rows[0] - u * rows[3], rows[1] - v * rows[3]
        sight = np.cross(across[:3], upright[:3])
        sight = sight if rows[3, :3] @ sight > 0 else -sight
        local = np.linalg.solve((self.world_from_camera @ FLIP)[:3, :3], sight)
        return float(local[0] / local[2]), float(local[1] / local[2])

    def place(self, direction: tuple[float, float]) -> tuple[float, float]:
        """Return where the region shows `direction`, in pixels from its lower left corner."""
        far = self.world_from_camera @ FLIP @ np.array([*direction, 1.0, 1.0])
        x, y, _, w = self.window_from_world @ far
        return float((x / w + 1.0) * self.width / 2.0), float((y / w + 1.0) * self.height / 2.0)


def photo_pixel(camera: Camera, direction: tuple[float, float]) -> tuple[float, float]:
    """Return the pixel of the photo, lens distortion and EXIF rotation included, that shows `direction`.

    Raises
    ------
    CameraError
        When it lies outside of the photo.
    """
    x, y = photo_pixels(camera, np.array([direction]))[0]
    if not (0.0 <= x < camera.width and 0.0 <= y < camera.height):
        raise CameraError(f"That is outside of the photo {camera.photo}. Click inside the camera's frame.")
    return round(float(x), 2), round(float(y), 2)


def require_same_place(camera: Camera, world_from_camera: Float64, world_from_scene: Float64) -> None:
    """Make sure that the scene's splats are seen from where the photo was taken.

    Parameters
    ----------
    camera : Camera
        Of the photo.
    world_from_camera, world_from_scene : array of shape [4, 4], float64
        ``matrix_world`` of the Blender camera and of the whole scene's splats. Both may be moved together.

    Raises
    ------
    CameraError
        When one was moved without the other.
    """
    seen = camera.viewmat @ np.linalg.solve(world_from_scene, world_from_camera @ FLIP)
    scale = np.cbrt(abs(np.linalg.det(seen[:3, :3])))
    turned = np.linalg.norm(seen[:3, :3] / max(scale, 1e-12) - np.eye(3))
    if turned > _MOST_TURN or np.linalg.norm(seen[:3, 3]) > _MOST_SHIFT:
        raise CameraError(
            f"The camera of {camera.photo} and the scene no longer stand as they did when the photo was taken. "
            "Undo the move, or open the project in a new file."
        )
