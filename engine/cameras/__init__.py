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
    from .pairs import n_compared_pairs
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

__all__ = [
    "SfmWorkspace",
    "check_given_cameras",
    "covering_pinhole",
    "detecting_cores",
    "detection_bytes",
    "distort",
    "estimate_cameras",
    "files_of_model",
    "has_points",
    "is_point_visible",
    "match_features",
    "n_compared_pairs",
    "normalised_points",
    "normalised_viewmat",
    "original_from_world",
    "project",
    "parse_camera_json",
    "read_camera_json",
    "read_cameras",
    "training_pinhole",
    "undistort",
]

__getattr__ = lazy_exports(__name__, __file__)
