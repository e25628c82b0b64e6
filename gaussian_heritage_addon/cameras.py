"""Cameras of a project as Blender cameras. Lens distortion is left out: Blender's pinhole has none."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from mathutils import Matrix

from ..engine.errors import ObjectError
from ..engine.scene import Camera, focal_and_center
from .picking import FLIP
from .properties import heritage_objects
from .splat_nodes import PIXEL, VIEW_HIGH, VIEW_LOW, set_display_input

__all__ = ["PHOTO_KEY", "add_cameras", "current_photo", "look_through"]

PHOTO_KEY = "heritage_photo"
_SENSOR = 36.0
_MARGIN = 0.15
"""Of the picture's size around it, where the engine still linearises (`JACOBIAN_MARGIN`)."""


def add_cameras(cameras: Sequence[Camera], collection: bpy.types.Collection) -> None:
    """Add a Blender camera for each of `cameras`, named after its photo."""
    for camera in cameras:
        fx, fy, cx, cy = focal_and_center(camera)
        data = bpy.data.cameras.new(camera.photo)
        data.sensor_fit, data.sensor_width = "HORIZONTAL", _SENSOR
        data.lens = fx * _SENSOR / camera.width
        data.shift_x = 0.5 - cx / camera.width
        # Blender counts both shifts in sensor widths, as scaled by the pixels' aspect.
        data.shift_y = (cy - camera.height / 2) / camera.width * (fx / fy)
        data.display_size = 0.05
        data.clip_start = 0.001
        obj = bpy.data.objects.new(camera.photo, data)
        obj.matrix_world = Matrix((np.linalg.inv(camera.viewmat) @ FLIP).tolist())
        obj[PHOTO_KEY] = camera.photo
        obj["heritage_size"] = [camera.width, camera.height]
        obj["heritage_pixel_aspect"] = fx / fy
        collection.objects.link(obj)


def current_photo(scene: bpy.types.Scene) -> str:
    """Return the name of the photo whose camera is the scene's; empty when it is another camera."""
    return "" if scene.camera is None else str(scene.camera.get(PHOTO_KEY, ""))


def look_through(scene: bpy.types.Scene, photo: str, longest_side: int = 0, *, step: int = 0) -> None:
    """Make the camera of `photo` the scene's, and a render as large as the photo and as soft as the engine's.

    Parameters
    ----------
    scene : Scene
    photo : str
        Name of the photo; empty for the one looked through now, else the first.
    longest_side : int
        Pixels of the longest side; 0 for the photo's own.
    step : int
        So many photos further, by name; after the last comes the first.

    Raises
    ------
    ObjectError
        When the scene has no such camera.
    """
    cameras = sorted((obj for obj in scene.objects if PHOTO_KEY in obj), key=lambda obj: obj[PHOTO_KEY])
    names = [obj[PHOTO_KEY] for obj in cameras]
    photo = photo or current_photo(scene) or (names[0] if names else "")
    if photo not in names:
        raise ObjectError(f"No camera of the photo {photo!r} is in this scene. Open the project with its cameras.")
    found = cameras[(names.index(photo) + step) % len(names)]
    scene.camera = found
    width, height = found["heritage_size"]
    shrink = min(1.0, longest_side / max(width, height)) if longest_side else 1.0
    render = scene.render
    render.resolution_x, render.resolution_y = max(1, round(width * shrink)), max(1, round(height * shrink))
    render.resolution_percentage = 100
    aspect = found["heritage_pixel_aspect"]
    # Blender wants both aspects to be at least 1.
    render.pixel_aspect_x, render.pixel_aspect_y = max(1.0, 1.0 / aspect), max(1.0, aspect)
    lens = found.data
    across = lens.sensor_width / lens.lens
    reach = 0.5 + _MARGIN
    reach_x, reach_y = reach * across, reach * across * aspect * height / width
    middle_x, middle_y = lens.shift_x * across, lens.shift_y * across
    for obj in heritage_objects(scene):
        set_display_input(obj, PIXEL, across / render.resolution_x)
        set_display_input(obj, VIEW_LOW, (middle_x - reach_x, middle_y - reach_y, 0.0))
        set_display_input(obj, VIEW_HIGH, (middle_x + reach_x, middle_y + reach_y, 0.0))
