"""Projection of directions to photo pixels, lens distortion included, for every COLMAP camera model. NumPy only.

The add-on and `engine.cameras.undistortion` share this projection. The inverse (pixel to direction) and the validation
of parameters are pycolmap's, in `engine.cameras.undistortion`.

Conventions: a direction is (x, y) for the point (x, y, 1) in the camera's frame (x right, y down, z forward).
Pixels are those of the photo after EXIF rotation; the top left corner is (0, 0), the centre of the first pixel
(0.5, 0.5). Parameters are in COLMAP's order, focal lengths and principal point first.

The formulas evaluate in the order of COLMAP's source (``src/colmap/sensor/models.h``): the pinhole, radial and
OpenCV models (without fisheye) give its pixels bit for bit, the others within 1e-12 pixels. See
docs/design_notes/cameras.md.
"""

from __future__ import annotations

import functools
import math
import reprlib
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from ..core.arrays import Float64
from ..core.errors import CameraError
from .camera import Camera, Lens

_Distortion = Callable[[Float64, Float64, Sequence[float]], tuple[Float64, Float64]]

_TURNING_POINT_ANGLES = 65
"""Angles around the optical axis at which the turning point is searched; it is interpolated between them."""
_TURNING_POINT_STEPS = np.linspace(0.0, 89.0, 891)
"""Degrees off the optical axis at which the search tests the lens model."""
FISHEYE_LENS: Final = "OPENCV_FISHEYE"
"""COLMAP's lens model for fisheye lenses, as of action cameras."""
MAX_LENS_PARAMETER = 1e9
"""Largest absolute parameter of a usable lens, and the inverse of the smallest focal length in pixels."""


def is_fisheye(model: str) -> bool:
    """Return whether a COLMAP lens model describes fisheye lenses."""
    return model.endswith("FISHEYE")


def lens_problem(lens: Lens) -> str | None:
    """Return why `lens` cannot be used, as a clause for a message; None for a usable one.

    Its model must be known and have this number of parameters, all finite, with focal lengths above 0.
    """
    if lens.model not in _MODELS:
        return f"the lens model {reprlib.repr(lens.model)} is not known"
    count = _MODELS[lens.model][1]
    if len(lens.params) != count:
        return f"the lens model {lens.model} has {count} parameters, not {len(lens.params)}"
    if not all(math.isfinite(value) and abs(value) <= MAX_LENS_PARAMETER for value in lens.params):
        return "a parameter of its lens is not finite or is too large"
    if min(focal_and_center(lens)[:2]) < 1 / MAX_LENS_PARAMETER:
        return "its focal length must be above 0"
    return None


def focal_and_center(camera: Camera | Lens) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy in pixels of the photo: the lens without its distortion."""
    p = camera.params
    return (p[0], p[0], p[1], p[2]) if _has_one_focal(camera.model) else (p[0], p[1], p[2], p[3])


def photo_pixels(camera: Camera, directions: Float64) -> Float64:
    """Return where directions appear in the photo.

    Parameters
    ----------
    directions : array of shape [N, 2]

    Returns
    -------
    array of shape [N, 2], float64
        x and y in pixels of the photo, also outside the photo; NaN beyond the turning point of the lens model, where
        distant directions would appear inside the photo again.

    Raises
    ------
    CameraError
        When the lens model is unknown.
    """
    if camera.model not in _MODELS:
        raise CameraError(f"The lens model {camera.model} of {camera.photo} is not known here. Type the pixel instead.")
    return lens_pixels(camera.lens, directions)


def lens_pixels(lens: Lens, directions: Float64) -> Float64:
    """Return what `photo_pixels` returns for directions [N, 2], for a lens without a photo; its model must be known."""
    pixels = _project(lens, directions)
    angles, reaches = _turning_points(lens)
    reach = np.interp(np.arctan2(directions[:, 1], directions[:, 0]), angles, reaches)
    pixels[np.linalg.norm(directions, axis=1) > reach] = np.nan
    return pixels


def _project(lens: Lens, directions: Float64) -> Float64:
    """Return pixels of directions of shape [..., 2], without regard to the turning point."""
    fx, fy, cx, cy = focal_and_center(lens)
    distortion = lens.params[3 if _has_one_focal(lens.model) else 4 :]
    directions = np.asarray(directions, np.float64)
    # Far outside the photo a model may divide by zero or have no real root.
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        x, y = _MODELS[lens.model][0](directions[..., 0], directions[..., 1], distortion)
    return np.stack([fx * x + cx, fy * y + cy], axis=-1)


def _has_one_focal(model: str) -> bool:
    return model.startswith("SIMPLE_") or model in ("RADIAL", "RADIAL_FISHEYE")


@functools.lru_cache(maxsize=256)
def _turning_points(lens: Lens) -> tuple[Float64, Float64]:
    """Return angles [A] around the optical axis and, for each, the largest direction before the turning point [A].

    A distortion polynomial turns back at some distance from the axis. The search goes outwards in steps of 0.1
    degrees, up to 89 degrees off the axis, as long as the pixels move away from the principal point.
    """
    angles = np.linspace(-np.pi, np.pi, _TURNING_POINT_ANGLES)
    distances = np.tan(np.radians(_TURNING_POINT_STEPS))
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None] * distances[:, None]
    pixels = _project(lens, directions)
    off_axis = np.linalg.norm(pixels - pixels[:, :1], axis=2)
    with np.errstate(invalid="ignore"):
        outwards = np.diff(off_axis, axis=1) > 0.0
    steps = np.where(outwards.all(axis=1), outwards.shape[1], np.argmin(outwards, axis=1))
    return angles, distances[steps]


# ---- the distortion of each model; k are the parameters after focal lengths and principal point


def _without_distortion(u: Float64, v: Float64, _: Sequence[float]) -> tuple[Float64, Float64]:
    return u, v


def _simple_radial(u: Float64, v: Float64, k: Sequence[float]) -> tuple[Float64, Float64]:
    radial = k[0] * (u * u + v * v)
    return u + u * radial, v + v * radial


def _radial(u: Float64, v: Float64, k: Sequence[float]) -> tuple[Float64, Float64]:
    r2 = u * u + v * v
    radial = k[0] * r2 + k[1] * r2 * r2
    return u + u * radial, v + v * radial


def _opencv(u: Float64, v: Float64, k: Sequence[float]) -> tuple[Float64, Float64]:
    r2 = u * u + v * v
    du, dv = _add_tangential(u, v, k[0] * r2 + k[1] * r2 * r2, k[2], k[3])
    return u + du, v + dv


def _full_opencv(u: Float64, v: Float64, k: Sequence[float]) -> tuple[Float64, Float64]:
    r2 = u * u + v * v
    r4 = r2 * r2
    r6 = r4 * r2
    radial = (1.0 + k[0] * r2 + k[1] * r4 + k[4] * r6) / (1.0 + k[5] * r2 + k[6] * r4 + k[7] * r6)
    du, dv = _add_tangential(u, v, radial, k[2], k[3])
    return u + (du - u), v + (dv - v)


def _add_tangential(u: Float64, v: Float64, radial: Float64, p1: float, p2: float) -> tuple[Float64, Float64]:
    """Return ``radial`` times (u, v) plus Brown's tangential distortion in OpenCV's order: p1 acts on v, p2 on u."""
    uv, r2 = u * v, u * u + v * v
    du = u * radial + 2.0 * p1 * uv + p2 * (r2 + 2.0 * (u * u))
    dv = v * radial + 2.0 * p2 * uv + p1 * (r2 + 2.0 * (v * v))
    return du, dv


def _angular(u: Float64, v: Float64) -> tuple[Float64, Float64]:
    """Return (u, v) with its length, the tangent of an angle, replaced by the angle."""
    r = np.sqrt(u * u + v * v)
    factor = np.where(r > 1e-12, np.arctan(r) / np.maximum(r, 1e-12), 1.0)
    return u * factor, v * factor


def _fisheye(u: Float64, v: Float64, k: Sequence[float]) -> tuple[Float64, Float64]:
    u, v = _angular(u, v)
    radial = _even_polynomial(u * u + v * v, k)
    return u + u * radial, v + v * radial


def _even_polynomial(square: Float64, coefficients: Sequence[float]) -> Float64:
    """Return ``c1 s + c2 s^2 + ...`` with ``s = square``."""
    total, power = np.zeros_like(square), np.ones_like(square)
    for coefficient in coefficients:
        power = power * square
        total = total + coefficient * power
    return total


def _thin_prism_fisheye(u: Float64, v: Float64, k: Sequence[float]) -> tuple[Float64, Float64]:
    u, v = _angular(u, v)
    r2 = u * u + v * v
    du, dv = _add_tangential(u, v, _even_polynomial(r2, (k[0], k[1], k[4], k[5])), k[2], k[3])
    return u + (du + k[6] * r2), v + (dv + k[7] * r2)


def _rad_tan_thin_prism_fisheye(u: Float64, v: Float64, k: Sequence[float]) -> tuple[Float64, Float64]:
    u, v = _fisheye(u, v, k[:6])
    r2 = u * u + v * v
    # In this model the first tangential coefficient acts on u.
    du, dv = _add_tangential(u, v, np.zeros_like(r2), k[7], k[6])
    return u + du + r2 * (k[8] + r2 * k[9]), v + dv + r2 * (k[10] + r2 * k[11])


def _fov(u: Float64, v: Float64, k: Sequence[float]) -> tuple[Float64, Float64]:
    omega, r2 = k[0], u * u + v * v
    if omega * omega < 1e-4:
        factor = omega * omega * r2 / 3.0 - omega * omega / 12.0 + 1.0
        return u * factor, v * factor
    tangent = np.tan(omega / 2.0)
    r = np.sqrt(np.maximum(r2, 1e-4))
    near_axis = -2.0 * tangent * (4.0 * r2 * tangent * tangent - 3.0) / (3.0 * omega)
    factor = np.where(r2 < 1e-4, near_axis, np.arctan(r * 2.0 * tangent) / (r * omega))
    return u * factor, v * factor


def _division(u: Float64, v: Float64, k: Sequence[float]) -> tuple[Float64, Float64]:
    """Solve ``undistorted = distorted / (1 + k |distorted|^2)`` for the distorted direction."""
    divisor = 1.0 + np.sqrt(1.0 - 4.0 * (u * u + v * v) * k[0])
    return 2.0 * u / divisor, 2.0 * v / divisor


def _eucm(u: Float64, v: Float64, k: Sequence[float]) -> tuple[Float64, Float64]:
    """Apply the enhanced unified camera model, Khomutenko et al. 2016."""
    denominator = k[0] * np.sqrt(k[1] * (u * u + v * v) + 1.0) + (1.0 - k[0])
    return u / denominator, v / denominator


_MODELS: dict[str, tuple[_Distortion, int]] = {
    "SIMPLE_PINHOLE": (_without_distortion, 3),
    "PINHOLE": (_without_distortion, 4),
    "SIMPLE_RADIAL": (_simple_radial, 4),
    "RADIAL": (_radial, 5),
    "OPENCV": (_opencv, 8),
    "FULL_OPENCV": (_full_opencv, 12),
    "SIMPLE_FISHEYE": (_fisheye, 3),
    "FISHEYE": (_fisheye, 4),
    "SIMPLE_RADIAL_FISHEYE": (_fisheye, 4),
    "RADIAL_FISHEYE": (_fisheye, 5),
    FISHEYE_LENS: (_fisheye, 8),
    "THIN_PRISM_FISHEYE": (_thin_prism_fisheye, 12),
    "RAD_TAN_THIN_PRISM_FISHEYE": (_rad_tan_thin_prism_fisheye, 16),
    "FOV": (_fov, 5),
    "SIMPLE_DIVISION": (_division, 4),
    "DIVISION": (_division, 5),
    "EUCM": (_eucm, 6),
}
"""Distortion and number of parameters of each model, focal lengths and principal point included."""
