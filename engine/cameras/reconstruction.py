"""Conversion of a pycolmap reconstruction to a `CameraSet` in the normalised world."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float64
from ..scene import Camera, CameraHealth, CameraSet
from .colmap import pycolmap
from .normalise import normalised_points, normalised_viewmat, original_from_world

_DECIMALS, _DIGITS = 8, 9
"""Decimals and significant digits of estimated cameras, see `rounded`."""


def viewmat_of(image: pycolmap.Image) -> Float64:
    """Return the world-to-camera matrix [4, 4] of a registered image."""
    viewmat = np.eye(4)
    viewmat[:3] = image.cam_from_world().matrix()
    return viewmat


def camera_in_photo(photo: str, lens: pycolmap.Camera, width: int, height: int, viewmat: Float64) -> Camera:
    """Return a `Camera` with the parameters of `lens`, which belongs to a copy, scaled to pixels of the photo.

    `width` and `height` are those of the photo, `viewmat` is world-to-camera, [4, 4].
    """
    scaled = copy.deepcopy(lens)
    if (scaled.width, scaled.height) != (width, height):
        scaled.rescale(width, height)
    return Camera(photo, width, height, scaled.model_name, tuple(float(value) for value in scaled.params), viewmat)


def is_scaled(size: tuple[float, float], photo: tuple[float, float]) -> bool:
    """Return whether `size` can be the size (width, height) of the `photo` at another scale, with rounded sides."""
    (w, h), (width, height) = size, photo
    return abs(w * height - h * width) <= 0.5 * (max(w, width) + max(h, height)) + 1.0


def points_of(reconstruction: pycolmap.Reconstruction) -> tuple[Float64, NDArray[np.uint8]]:
    """Return positions [P, 3] and sRGB colours [P, 3] of the finite sparse points, in the order of their ids."""
    found = reconstruction.points3D
    points, colors = np.empty((len(found), 3)), np.empty((len(found), 3), np.uint8)
    # Row by row: a list of arrays for a million points takes 400 MB.
    for row, point_id in enumerate(sorted(found)):
        point = found[point_id]
        points[row], colors[row] = point.xyz, point.color
    finite = np.isfinite(points).all(axis=1)
    return points[finite], colors[finite]


def camera_set(
    cameras: Iterable[Camera],
    photo_names: Iterable[str],
    points: Float64,
    colors: NDArray[np.uint8],
    *,
    reprojection_error: float,
    poses_given: bool,
    health: CameraHealth | None = None,
) -> CameraSet:
    """Return a normalised `CameraSet` of `cameras` and `points`, which are in the same original frame.

    Parameters
    ----------
    cameras : iterable of Camera
        At least one.
    photo_names : iterable of str
        Names of all photos; photos without a camera are listed as unregistered.
    points : array of shape [P, 3], float64
        Sparse points.
    colors : array of shape [P, 3], uint8
        Their sRGB colours.
    reprojection_error : float
        Mean error in pixels; NaN or negative when unknown.
    poses_given : bool
        Whether the user supplied the poses.
    health : CameraHealth, optional
        Finding of the health check.
    """
    ordered = sorted(cameras, key=lambda camera: camera.photo)
    similarity = original_from_world([camera.viewmat for camera in ordered], points)
    registered = {camera.photo for camera in ordered}
    return CameraSet(
        cameras=tuple(
            dataclasses.replace(camera, viewmat=normalised_viewmat(camera.viewmat, similarity)) for camera in ordered
        ),
        unregistered=tuple(sorted(name for name in photo_names if name not in registered)),
        points=normalised_points(points, similarity),
        point_colors=colors,
        reprojection_error=float(reprojection_error) if reprojection_error >= 0.0 else math.nan,
        original_from_world=similarity,
        poses_given=poses_given,
        health=health,
    )


def rounded(found: CameraSet) -> CameraSet:
    """Return estimated cameras without the digits in which processors and libraries differ.

    These are the last ones of double precision, and training makes them visible. View matrices and the similarity to
    COLMAP's frame, which is as large, keep 8 decimals, less than a thousandth of a pixel; lenses and the error keep 9
    significant digits. Points are in single precision already.
    """
    return dataclasses.replace(
        found,
        cameras=tuple(
            dataclasses.replace(
                camera, params=tuple(_significant(value) for value in camera.params), viewmat=_decimal(camera.viewmat)
            )
            for camera in found.cameras
        ),
        original_from_world=_decimal(found.original_from_world),
        reprojection_error=_significant(found.reprojection_error),
    )


def _significant(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _decimal(matrix: Float64) -> Float64:
    # Adding zero makes negative zeros positive.
    return matrix.round(_DECIMALS) + 0.0
