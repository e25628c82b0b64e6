"""Maps positions in the window to pixels of the photo whose camera is looked through, and back. No bpy.

Blender's cameras look along -Z with Y up and have no lens distortion; pixels of a photo include the distortion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...engine.core.arrays import Float64
from ...engine.core.errors import CameraError
from ...engine.scene import Camera, photo_pixels, similarity_scale
from ..splats.sight import Sight

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""Converts between COLMAP's camera axes and Blender's, in both directions."""
_MAX_ROTATION, _MAX_TRANSLATION = 1e-3, 1e-3
"""Largest pose differences, in radians and scene units, that count as unmoved.

Float32 rounding stays below them; moving a camera by hand exceeds them."""


@dataclass(frozen=True)
class View(Sight):
    """A region of the window that shows the view of a camera.

    Attributes
    ----------
    world_from_camera : array of shape [4, 4], float64
        Placement of the Blender camera.
    """

    world_from_camera: Float64

    def direction(self, x: float, y: float) -> tuple[float, float]:
        """Return the direction (x/z, y/z) seen at (x, y) in the region, in pixels from its lower left corner."""
        local = _solved((self.world_from_camera @ FLIP)[:3, :3], self.ray(x, y)[1])
        return float(local[0] / local[2]), float(local[1] / local[2])

    def region_position(self, direction: tuple[float, float]) -> tuple[float, float]:
        """Return the position in the region that shows `direction`, in pixels from its lower left corner."""
        point = self.world_from_camera @ FLIP @ np.array([*direction, 1.0, 1.0])
        x, y = self.positions(point[None, :3])[0]
        return float(x), float(y)


def photo_pixel(camera: Camera, direction: tuple[float, float]) -> tuple[float, float]:
    """Return the pixel of the photo that shows `direction`, with lens distortion and after EXIF rotation.

    Raises
    ------
    CameraError
        When the pixel is outside the photo.
    """
    x, y = photo_pixels(camera, np.array([direction]))[0]
    if not (0.0 <= x < camera.width and 0.0 <= y < camera.height):
        raise CameraError(f"This position is outside the photo {camera.photo}. Click inside the camera frame.")
    return round(float(x), 2), round(float(y), 2)


def require_aligned(camera: Camera, world_from_camera: Float64, world_from_scene: Float64) -> None:
    """Raise unless the pose of the camera relative to the splats is that of the photo.

    Parameters
    ----------
    camera : Camera
        Camera of the photo.
    world_from_camera, world_from_scene : array of shape [4, 4], float64
        Placements of the Blender camera and of the splats of the whole scene. Moving both together is allowed.

    Raises
    ------
    CameraError
        When only one of them was moved.
    """
    relative_pose = camera.viewmat @ _solved(world_from_scene, world_from_camera @ FLIP)
    scale = similarity_scale(relative_pose)
    rotation = np.linalg.norm(relative_pose[:3, :3] / max(scale, 1e-12) - np.eye(3))
    if rotation > _MAX_ROTATION or np.linalg.norm(relative_pose[:3, 3]) > _MAX_TRANSLATION:
        raise CameraError(
            f"The camera of {camera.photo} no longer lines up with the scene, because one of them was moved. "
            "Undo the move, or open the project in a new file."
        )


def _solved(matrix: Float64, values: Float64) -> Float64:
    """Return the product of the inverse of `matrix` and `values`."""
    try:
        solved = np.linalg.solve(matrix, values)
    except np.linalg.LinAlgError as error:
        raise CameraError("The camera or the scene is flattened. Give it a scale other than 0.") from error
    if not np.isfinite(solved).all():
        raise CameraError("The camera or the scene is not at a finite position. Move it back.")
    return np.asarray(solved, np.float64)
