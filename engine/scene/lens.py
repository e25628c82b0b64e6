"""From a direction to the pixel of a photo, lens distortion included: COLMAP's camera models in NumPy. No bpy.

A direction is (x, y) with the point (x, y, 1) in the camera's frame: x right, y down, z forward.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import CameraError
from .camera import Camera

__all__ = ["focal_and_center", "photo_pixels"]

Float64 = NDArray[np.float64]
_Distortion = Callable[[Float64, Sequence[float]], Float64]
_STEPS = 200
"""Along the way from the optical axis, where the lens model must lead outwards."""


def focal_and_center(camera: Camera) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy in pixels of the photo: what is left of the lens without its distortion."""
    p = camera.params
    return (p[0], p[0], p[1], p[2]) if _has_one_focal(camera.model) else (p[0], p[1], p[2], p[3])


def photo_pixels(camera: Camera, directions: Float64) -> Float64:
    """Return where directions appear in the photo, as `engine.cameras.undistortion.project` does.

    Parameters
    ----------
    camera : Camera
    directions : array of shape [N, 2]

    Returns
    -------
    array of shape [N, 2], float64
        x and y in pixels of the photo after EXIF rotation, the top left corner being (0, 0), also outside of it; NaN
        beyond the point where the lens model turns back inwards.

    Raises
    ------
    CameraError
        When the lens model is not known here.
    """
    fx, fy, cx, cy = focal_and_center(camera)
    outwards = _is_outwards(camera, directions)
    pixels = _distorted(camera, directions) * (fx, fy) + (cx, cy)
    pixels[~outwards] = np.nan
    return pixels


def _has_one_focal(model: str) -> bool:
    return model.startswith("SIMPLE_") or model in ("RADIAL", "RADIAL_FISHEYE")


def _distorted(camera: Camera, directions: Float64) -> Float64:
    distortion = _DISTORTIONS.get(camera.model)
    if distortion is None:
        raise CameraError(f"The lens model {camera.model} of {camera.photo} is not known here. Type the pixel instead.")
    return distortion(np.asarray(directions, np.float64), camera.params[3 if _has_one_focal(camera.model) else 4 :])


def _is_outwards(camera: Camera, directions: Float64) -> NDArray[np.bool_]:
    """Return [N]: on the straight way from the axis to the direction the distorted distance only grows."""
    steps = np.linspace(0.0, 1.0, _STEPS + 1)[:, None, None] * directions[None]
    with np.errstate(invalid="ignore"):
        distorted = _distorted(camera, steps.reshape(-1, 2)).reshape(steps.shape)
        reach = np.linalg.norm(distorted - distorted[:1], axis=2)
        grows: NDArray[np.bool_] = (np.diff(reach, axis=0) >= 0.0).all(axis=0)
    return grows


# ---- the models, in COLMAP's order of parameters after focal lengths and centre


def _series(square: Float64, coefficients: Sequence[float]) -> Float64:
    """Return ``1 + c1 s + c2 s^2 + ...`` with ``s = square``."""
    return np.asarray(np.polynomial.polynomial.polyval(square, [1.0, *coefficients]))


def _square(uv: Float64) -> Float64:
    return np.sum(uv * uv, axis=-1, keepdims=True)


def _tangential(uv: Float64, p1: float, p2: float) -> Float64:
    """Brown's decentring, OpenCV's order: p1 acts on v, p2 on u."""
    u, v, square = uv[..., :1], uv[..., 1:], _square(uv)
    du = 2.0 * p1 * u * v + p2 * (square + 2.0 * u * u)
    dv = 2.0 * p2 * u * v + p1 * (square + 2.0 * v * v)
    return np.concatenate([du, dv], axis=-1)


def _none(uv: Float64, _: Sequence[float]) -> Float64:
    return uv


def _radial(uv: Float64, k: Sequence[float]) -> Float64:
    return uv * _series(_square(uv), k)


def _opencv(uv: Float64, k: Sequence[float]) -> Float64:
    return _radial(uv, k[:2]) + _tangential(uv, k[2], k[3])


def _full_opencv(uv: Float64, k: Sequence[float]) -> Float64:
    square = _square(uv)
    ratio = _series(square, (k[0], k[1], k[4])) / _series(square, k[5:8])
    return uv * ratio + _tangential(uv, k[2], k[3])


def _angular(uv: Float64) -> Float64:
    """Return `uv` with its length, a tangent, replaced by the angle."""
    length = np.sqrt(_square(uv))
    return uv * np.where(length > 1e-12, np.arctan(length) / np.maximum(length, 1e-12), 1.0)


def _fisheye(uv: Float64, k: Sequence[float]) -> Float64:
    return _radial(_angular(uv), k)


def _thin_prism_fisheye(uv: Float64, k: Sequence[float]) -> Float64:
    bent = _angular(uv)
    prism = _square(bent) * np.array(k[6:8])
    return _radial(bent, (k[0], k[1], k[4], k[5])) + _tangential(bent, k[2], k[3]) + prism


def _rad_tan_thin_prism_fisheye(uv: Float64, k: Sequence[float]) -> Float64:
    bent = _radial(_angular(uv), k[:6])
    square = _square(bent)
    prism = square * (np.array([k[8], k[10]]) + square * np.array([k[9], k[11]]))
    # Here the first coefficient acts on u.
    return bent + _tangential(bent, k[7], k[6]) + prism


def _fov(uv: Float64, k: Sequence[float]) -> Float64:
    length, omega = np.sqrt(_square(uv)), k[0]
    if abs(omega) < 1e-6:
        return uv
    factor = np.arctan(length * 2.0 * np.tan(omega / 2.0)) / (np.maximum(length, 1e-12) * omega)
    return uv * np.where(length > 1e-12, factor, 2.0 * np.tan(omega / 2.0) / omega)


def _division(uv: Float64, k: Sequence[float]) -> Float64:
    """``undistorted = distorted / (1 + k |distorted|^2)``, solved for the distorted one."""
    return uv * 2.0 / (1.0 + np.sqrt(1.0 - 4.0 * k[0] * _square(uv)))


def _eucm(uv: Float64, k: Sequence[float]) -> Float64:
    """Enhanced unified camera model, Khomutenko et al. 2016."""
    return uv / (k[0] * np.sqrt(k[1] * _square(uv) + 1.0) + 1.0 - k[0])


_DISTORTIONS: dict[str, _Distortion] = {
    "SIMPLE_PINHOLE": _none,
    "PINHOLE": _none,
    "SIMPLE_RADIAL": _radial,
    "RADIAL": _radial,
    "OPENCV": _opencv,
    "FULL_OPENCV": _full_opencv,
    "SIMPLE_FISHEYE": _fisheye,
    "FISHEYE": _fisheye,
    "SIMPLE_RADIAL_FISHEYE": _fisheye,
    "RADIAL_FISHEYE": _fisheye,
    "OPENCV_FISHEYE": _fisheye,
    "THIN_PRISM_FISHEYE": _thin_prism_fisheye,
    "RAD_TAN_THIN_PRISM_FISHEYE": _rad_tan_thin_prism_fisheye,
    "FOV": _fov,
    "SIMPLE_DIVISION": _division,
    "DIVISION": _division,
    "EUCM": _eucm,
}
