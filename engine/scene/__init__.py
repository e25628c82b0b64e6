"""The data that travels between packages: photos, cameras, lenses, Gaussians, and their files. NumPy only.

Blender imports this package too.
"""

from __future__ import annotations

from .camera import Camera, CameraSet, PinholeCamera
from .camera_storage import read_camera_set, write_camera_set
from .gaussians import FEATURE_DIM, Gaussians
from .lens import focal_and_center, photo_pixels
from .photo import Photo, PhotoSet, RejectedPhoto
from .photo_storage import read_photo_set, write_photo_set
from .polished import Polished, forget_polished, load_polished, save_polished

__all__ = [
    "FEATURE_DIM",
    "Camera",
    "CameraSet",
    "Gaussians",
    "Photo",
    "PhotoSet",
    "PinholeCamera",
    "Polished",
    "RejectedPhoto",
    "focal_and_center",
    "forget_polished",
    "load_polished",
    "photo_pixels",
    "read_camera_set",
    "read_photo_set",
    "save_polished",
    "write_camera_set",
    "write_photo_set",
]
