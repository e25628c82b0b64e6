"""Shows a photo as the background image of its camera, over the splats, so that it can be clicked."""

from __future__ import annotations

import hashlib
from pathlib import Path

import bpy
import numpy as np

from ...engine.core.errors import PhotoError
from ...engine.core.files import path_within
from ...engine.scene import Camera, read_photo_set
from ..splats.properties import photo_alpha
from .photo_frame import apply_orientation, exif_orientation, remove_distortion, require_small

_LONGEST_SIDE = 1600
"""Longest side of the background image in pixels. A viewport shows no more detail."""
_MAX_PIXELS = 200_000_000
"""Pixels of a photo that Blender decodes, at 4 bytes each. A small file may state any number of pixels."""


def show_backdrop(scene: bpy.types.Scene, camera: Camera, project: Path) -> None:
    """Show the photo of `camera`, without its lens distortion, in the view of the camera of `scene`.

    Raises
    ------
    HeritageError
        When the photo is missing, or Blender cannot read it.
    """
    data = scene.camera.data
    if not any(background.image is not None and background.image.has_data for background in data.background_images):
        data.background_images.clear()
        background = data.background_images.new()
        background.image = _load_background_image(camera, project)
        # Fill the camera's frame, which has the shape of the photo even where pixels are not square.
        background.frame_method, background.display_depth = "STRETCH", "FRONT"
        background.alpha = photo_alpha(scene)
    data.show_background_images = True


def _load_background_image(camera: Camera, project: Path) -> bpy.types.Image:
    file = path_within(read_photo_set(path_within(project, "photos", "photos.json")).folder, camera.photo)
    if not file.is_file():
        raise PhotoError(f"The photo {file} is missing. Click on the splats instead.")
    require_small(file, _MAX_PIXELS)
    photo = bpy.data.images.load(str(file))
    try:
        if 0 in photo.size:
            raise PhotoError(f"Blender cannot read {file}. Click on the splats instead.")
        shrink = min(1.0, _LONGEST_SIDE / max(photo.size))
        width, height = (max(1, round(side * shrink)) for side in photo.size)
        photo.scale(width, height)
        pixels = np.empty(width * height * 4, np.float32)
        photo.pixels.foreach_get(pixels)
    finally:
        bpy.data.images.remove(photo)
    # Blender stores the bottom row first and ignores the EXIF orientation.
    upright = apply_orientation(pixels.reshape(height, width, 4)[::-1], exif_orientation(file))
    undistorted = remove_distortion(np.ascontiguousarray(upright), camera)[::-1]
    image = bpy.data.images.new(f"Photo {camera.photo}", undistorted.shape[1], undistorted.shape[0], alpha=True)
    image.pixels.foreach_set(np.ascontiguousarray(undistorted).ravel())
    # Saved to Blender's temporary folder: not stored in the .blend file, but restored by undo.
    name = hashlib.sha256(str(file).encode()).hexdigest()[:16]
    image.filepath_raw, image.file_format = str(Path(bpy.app.tempdir) / f"{name}.png"), "PNG"
    image.save()
    return image
