"""Cameras of the photos, estimated by structure from motion with pycolmap or read from a file, and undistortion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from .features import SfmWorkspace, match_features
    from .given import has_points, read_cameras
    from .given_check import check_given_cameras
    from .model_places import files_of_model
    from .normalise import normalised_points, normalised_viewmat, original_from_world
    from .pairs import comparison_work
    from .processes import detecting_cores, detection_bytes
    from .sfm import estimate_cameras
    from .undistortion import (
        covering_pinhole,
        distort,
        is_point_visible,
        parse_camera_json,
        project,
        read_camera_json,
        training_pinhole,
        undistort,
    )

__getattr__ = lazy_exports(__name__, __file__)
