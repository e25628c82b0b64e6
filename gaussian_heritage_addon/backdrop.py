"""The photo itself over the splats, in the view of its camera, so that it can be clicked."""

from __future__ import annotations

import hashlib
from pathlib import Path

import bpy
import numpy as np

from ..engine.errors import PhotoError
from ..engine.scene import Camera, read_photo_set
from .photo_frame import exif_orientation, turned_upright, without_distortion

__all__ = ["show_backdrop"]

_LONGEST_SIDE = 1600
"""Pixels: as sharp as a viewport shows it."""


def show_backdrop(obj: bpy.types.Object, camera: Camera, project: Path) -> None:
    """Lay the photo of `camera` over what the Blender camera `obj` sees, without its lens distortion.

    Raises
    ------
    HeritageError
        When the photo is gone, or is of a kind that Blender cannot read.
    """
    data = obj.data
    if not any(entry.image is not None and entry.image.has_data for entry in data.background_images):
        data.background_images.clear()
        entry = data.background_images.new()
        entry.image = _picture(camera, project)
        # Exactly the camera's frame, which has the photo's shape also where its pixels are not square.
        entry.frame_method, entry.display_depth = "STRETCH", "FRONT"
        entry.alpha = obj.users_scene[0].heritage.photo_opacity
    data.show_background_images = True


def _picture(camera: Camera, project: Path) -> bpy.types.Image:
    file = read_photo_set(project / "photos" / "photos.json").folder / camera.photo
    if not file.is_file():
        raise PhotoError(f"The photo {file} is not there any more. Click on the splats instead.")
    photo = bpy.data.images.load(str(file))
    try:
        if 0 in photo.size:
            raise PhotoError(f"Blender cannot show {file}. Click on the splats instead.")
        shrink = min(1.0, _LONGEST_SIDE / max(photo.size))
        width, height = (max(1, round(side * shrink)) for side in photo.size)
        photo.scale(width, height)
        pixels = np.empty(width * height * 4, np.float32)
        photo.pixels.foreach_get(pixels)
    finally:
        bpy.data.images.remove(photo)
    # Blender keeps pictures from the bottom row up, and does not heed EXIF.
    upright = turned_upright(pixels.reshape(height, width, 4)[::-1], exif_orientation(file))
    straight = without_distortion(np.ascontiguousarray(upright), camera)[::-1]
    image = bpy.data.images.new(f"Photo {camera.photo}", straight.shape[1], straight.shape[0], alpha=True)
    image.pixels.foreach_set(np.ascontiguousarray(straight).ravel())
    # On the disk until Blender ends: not in the .blend, and not lost by an undo.
    name = hashlib.sha256(str(file).encode()).hexdigest()[:16]
    image.filepath_raw, image.file_format = str(Path(bpy.app.tempdir) / f"{name}.png"), "PNG"
    image.save()
    return image
