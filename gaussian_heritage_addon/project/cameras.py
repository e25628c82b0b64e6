"""The cameras of a project as Blender cameras, without lens distortion: Blender's pinhole camera has none."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ...engine.core.errors import ObjectError
from ...engine.rasterizer.settings import JACOBIAN_MARGIN
from ...engine.scene import Camera, focal_and_center
from ..blender.world_placement import set_world_matrix
from ..splats.properties import PHOTO_KEY, photo_of
from ..splats.selection import heritage_objects
from ..splats.splat_nodes import PIXEL, VIEW_HIGH, VIEW_LOW, set_display_input
from .picking import FLIP

_SENSOR_WIDTH = 36.0
"""Sensor width of the Blender cameras in millimetres. Only its ratio to the focal length matters."""
_SIZE_KEY = "heritage_size"
"""Custom property of a camera: width and height of its photo in pixels."""
_PIXEL_ASPECT_KEY = "heritage_pixel_aspect"
"""Custom property of a camera: focal length in pixels along x, divided by the one along y."""

INITIAL_RENDER_SIDE = 1280
"""Longest side of renders in pixels, as set on import. Cycles is slow at the full size of a photo."""
_MAX_SIDE, _MAX_ASPECT = 100_000, 1000.0
"""No photo has more pixels on a side, and no lens a more uneven focal length."""


def add_cameras(cameras: Sequence[Camera], collection: bpy.types.Collection) -> None:
    """Add a hidden Blender camera for each of `cameras`, named after its photo."""
    for camera in cameras:
        fx, fy, cx, cy = focal_and_center(camera)
        data = bpy.data.cameras.new(camera.photo)
        data.sensor_fit, data.sensor_width = "HORIZONTAL", _SENSOR_WIDTH
        data.lens = fx * _SENSOR_WIDTH / camera.width
        data.shift_x = 0.5 - cx / camera.width
        # Blender measures both shifts in sensor widths, scaled by the pixel aspect.
        data.shift_y = (cy - camera.height / 2) / camera.width * (fx / fy)
        data.display_size = 0.05
        data.clip_start = 0.001
        obj = bpy.data.objects.new(camera.photo, data)
        set_world_matrix(obj, np.linalg.inv(camera.viewmat) @ FLIP)
        obj[PHOTO_KEY] = camera.photo
        obj[_SIZE_KEY] = [camera.width, camera.height]
        obj[_PIXEL_ASPECT_KEY] = fx / fy
        obj.hide_viewport = True
        collection.objects.link(obj)


def current_photo(scene: bpy.types.Scene) -> str:
    """Return the name of the photo whose camera is the scene camera; empty for any other camera."""
    return "" if scene.camera is None else photo_of(scene.camera)


def look_through(scene: bpy.types.Scene, photo: str, longest_side: int = 0, *, step: int = 0) -> None:
    """Make the camera of `photo` the scene camera and give renders the photo's size and the engine's low-pass filter.

    Parameters
    ----------
    photo : str
        Name of the photo; empty for that of the scene camera, or else the first photo.
    longest_side : int
        Longest side of a render in pixels; 0 for that of the photo.
    step : int
        Number of photos to move on from `photo`, by name; the first follows the last.

    Raises
    ------
    ObjectError
        When the scene has no such camera, or the size of its photo was changed.
    """
    cameras = sorted((obj for obj in scene.objects if photo_of(obj)), key=photo_of)
    names = [photo_of(obj) for obj in cameras]
    photo = photo or current_photo(scene) or (names[0] if names else "")
    if photo not in names:
        raise ObjectError(f"No camera of the photo {photo!r} is in this scene. Open the project with its cameras.")
    camera = cameras[(names.index(photo) + step) % len(names)]
    width, height, aspect = _shape_of_photo(camera)
    scene.camera = camera
    for obj in cameras:
        # Blender draws the photo behind or before the splats only where its camera is visible.
        obj.hide_viewport = obj != camera
    for collection in camera.users_collection:
        collection.hide_viewport = False
    shrink = min(1.0, longest_side / max(width, height)) if longest_side else 1.0
    render = scene.render
    render.resolution_x, render.resolution_y = max(1, round(width * shrink)), max(1, round(height * shrink))
    render.resolution_percentage = 100
    # Blender requires both aspects to be at least 1.
    render.pixel_aspect_x, render.pixel_aspect_y = max(1.0, 1.0 / aspect), max(1.0, aspect)
    lens = camera.data
    # Extents at distance 1 from the camera.
    picture_width = lens.sensor_width / lens.lens
    reach = 0.5 + JACOBIAN_MARGIN
    reach_x, reach_y = reach * picture_width, reach * picture_width * aspect * height / width
    center_x, center_y = lens.shift_x * picture_width, lens.shift_y * picture_width
    for obj in heritage_objects(scene):
        set_display_input(obj, PIXEL, picture_width / render.resolution_x)
        set_display_input(obj, VIEW_LOW, (center_x - reach_x, center_y - reach_y, 0.0))
        set_display_input(obj, VIEW_HIGH, (center_x + reach_x, center_y + reach_y, 0.0))


def _shape_of_photo(camera: bpy.types.Object) -> tuple[int, int, float]:
    """Return width and height of a camera's photo in pixels, and its pixel aspect."""
    try:
        width, height = (int(side) for side in camera[_SIZE_KEY])
        aspect = float(camera[_PIXEL_ASPECT_KEY])
    except (KeyError, TypeError, ValueError, OverflowError):
        width = height = aspect = 0
    if not (0 < width <= _MAX_SIDE and 0 < height <= _MAX_SIDE and 1 / _MAX_ASPECT < aspect < _MAX_ASPECT):
        raise ObjectError(f"The camera {camera.name} has lost the size of its photo. Open the project in a new file.")
    return width, height, aspect
