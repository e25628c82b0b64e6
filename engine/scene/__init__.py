"""The data that packages exchange, photos, cameras, lenses and Gaussians, and their files.

NumPy only, because the add-on imports this package into Blender.
"""

from __future__ import annotations

from .camera import Camera, CameraSet, Lens, PinholeCamera
from .camera_storage import MAX_COORDINATE, camera_problem, read_camera_set, write_camera_set
from .framing import looked_at
from .gaussians import FEATURE_DIM, Gaussians
from .lens import MAX_LENS_PARAMETER, focal_and_center, lens_pixels, photo_pixels
from .photo import Photo, PhotoSet, RejectedPhoto
from .photo_storage import MAX_PHOTO_SIDE, read_photo_set, write_photo_set
from .polished import Polished, load_polished, save_polished

__all__ = [
    "FEATURE_DIM",
    "MAX_COORDINATE",
    "MAX_LENS_PARAMETER",
    "MAX_PHOTO_SIDE",
    "Camera",
    "CameraSet",
    "Gaussians",
    "Lens",
    "Photo",
    "PhotoSet",
    "PinholeCamera",
    "Polished",
    "RejectedPhoto",
    "camera_problem",
    "focal_and_center",
    "lens_pixels",
    "load_polished",
    "looked_at",
    "photo_pixels",
    "read_camera_set",
    "read_photo_set",
    "save_polished",
    "write_camera_set",
    "write_photo_set",
]
