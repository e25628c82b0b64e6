"""The data that packages exchange, photos, cameras, lenses, Gaussians and measurements, and their files.

NumPy only, because the add-on imports this package into Blender.
"""

from __future__ import annotations

from .camera import MAX_COORDINATE, Camera, CameraSet, Lens, PinholeCamera, similarity_scale
from .camera_health import CameraHealth
from .camera_storage import camera_problem, read_camera_set, write_camera_set
from .detailed import Detailed, load_detailed, read_detailed, save_detailed
from .extents import bottom_middle, box_of, far_gaussians
from .framing import looked_at
from .gaussians import FEATURE_DIM, Gaussians
from .lens import FISHEYE_LENS, MAX_LENS_PARAMETER, focal_and_center, is_fisheye, lens_pixels, photo_pixels
from .measurement import ExportFrame, MeasuredDistance, Measurement, Point, export_frame, measurement_problem
from .measurement_storage import delete_measurement, load_measurement, save_measurement
from .mesh import Mesh, are_closed
from .photo import Photo, PhotoSet, RejectedPhoto
from .photo_names import OTHER_SUFFIXES, RAW_SUFFIXES, READ_SUFFIXES, NameMatches, match_names, photos_called
from .photo_storage import MAX_PHOTO_SIDE, read_photo_set, write_photo_set
from .rays import RayCaster, RayHits, photo_ray, surface_point
from .rotations import is_rotation, rotations_from_quats, unit_quats
