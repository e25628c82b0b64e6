"""Cameras of a project as Blender cameras. Lens distortion is left out: Blender's pinhole has none."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Matrix

from ..engine.cameras.camera import Camera
from ..engine.errors import ObjectError
from .properties import heritage_objects
from .splat_nodes import PIXEL, VIEW_HIGH, VIEW_LOW, set_display_input

__all__ = ["PHOTO_KEY", "add_cameras", "look_through"]

PHOTO_KEY = "heritage_photo"
_SENSOR = 36.0
_MARGIN = 0.15
"""Of the picture's size around it, where the engine still linearises (`JACOBIAN_MARGIN`)."""


def add_cameras(cameras: Sequence[Camera], collection: bpy.types.Collection) -> None:
    """Add a Blender camera for each of `cameras`, named after its photo."""
    for camera in cameras:
        fx, fy, cx, cy = _pinhole(camera)
        data = bpy.data.cameras.new(camera.photo)
        data.sensor_fit, data.sensor_width = "HORIZONTAL", _SENSOR
        data.lens = fx * _SENSOR / camera.width
        data.shift_x = 0.5 - cx / camera.width
        # Blender counts both shifts in sensor widths, as scaled by the pixels' aspect.
        data.shift_y = (cy - camera.height / 2) / camera.width * (fx / fy)
        data.display_size = 0.05
        data.clip_start = 0.001
        obj = bpy.data.objects.new(camera.photo, data)
        # COLMAP looks along +Z with Y down, Blender along -Z with Y up.
        obj.matrix_world = Matrix((np.linalg.inv(camera.viewmat) @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist())
        obj[PHOTO_KEY] = camera.photo
        obj["heritage_size"] = [camera.width, camera.height]
        obj["heritage_pixel_aspect"] = fx / fy
        collection.objects.link(obj)


def _pinhole(camera: Camera) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy of any COLMAP model: single-focal ones begin with f, cx, cy, the others with all four."""
    p = camera.params
    if camera.model.startswith(("SIMPLE_", "RADIAL")):
        return p[0], p[0], p[1], p[2]
    return p[0], p[1], p[2], p[3]


def look_through(scene: bpy.types.Scene, photo: str, longest_side: int = 0) -> None:
    """Make the camera of `photo` the scene's, and a render as large as the photo and as soft as the engine's.

    Parameters
    ----------
    scene : Scene
    photo : str
        Name of the photo; empty for the first.
    longest_side : int
        Pixels of the longest side; 0 for the photo's own.

    Raises
    ------
    ObjectError
        When the scene has no such camera.
    """
    cameras = sorted((obj for obj in scene.objects if PHOTO_KEY in obj), key=lambda obj: obj[PHOTO_KEY])
    found = [obj for obj in cameras if photo in ("", obj[PHOTO_KEY])]
    if not found:
        raise ObjectError(f"No camera of the photo {photo!r} is in this scene. Open the project with its cameras.")
    scene.camera = found[0]
    width, height = found[0]["heritage_size"]
    shrink = min(1.0, longest_side / max(width, height)) if longest_side else 1.0
    render = scene.render
    render.resolution_x, render.resolution_y = max(1, round(width * shrink)), max(1, round(height * shrink))
    render.resolution_percentage = 100
    aspect = found[0]["heritage_pixel_aspect"]
    # Blender wants both aspects to be at least 1.
    render.pixel_aspect_x, render.pixel_aspect_y = max(1.0, 1.0 / aspect), max(1.0, aspect)
    lens = found[0].data
    across = lens.sensor_width / lens.lens
    reach = 0.5 + _MARGIN
    reach_x, reach_y = reach * across, reach * across * aspect * height / width
    middle_x, middle_y = lens.shift_x * across, lens.shift_y * across
    for obj in heritage_objects(scene):
        set_display_input(obj, PIXEL, across / render.resolution_x)
        set_display_input(obj, VIEW_LOW, (middle_x - reach_x, middle_y - reach_y, 0.0))
        set_display_input(obj, VIEW_HIGH, (middle_x + reach_x, middle_y + reach_y, 0.0))
