"""Rays through Gaussians: what the eye sees at a position of a photo or a window. NumPy only.

A ray meets a Gaussian where the density along the ray is highest. Opacities are blended front to back as in the
rasterizer (Kerbl et al. 2023), but with the density on the ray itself instead of the linearised projection.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float64
from ..core.errors import CameraError
from .camera import Camera
from .gaussians import Gaussians
from .lens import focal_and_center, photo_pixels
from .measurement import Point
from .rotations import rotations_from_quats

_ALPHA_MIN, _ALPHA_MAX = 1.0 / 255.0, 0.99  # Kerbl 2023
"""Of a Gaussian at a place: not drawn below, never more; as in the rasterizer."""
_NEAREST = 1e-6
"""Smallest distance of a Gaussian from the origin of a ray, world units."""
_MIN_OPACITY = 0.5
"""A ray meets a surface where half of its light is blocked."""
_INVERSION_STEPS = 20
"""Newton steps after which the search for the direction of a pixel has ended in float64, or never will."""
_INVERSION_TOLERANCE = 1e-3
"""Pixels."""


@dataclass(frozen=True)
class RayHits:
    """The K Gaussians that a ray meets, front to back.

    Attributes
    ----------
    rows : array of shape [K], int64
    distances : array of shape [K], float64
        From the origin of the ray to where its density is highest, world units.
    alphas : array of shape [K], float64
        Opacities on the ray.
    """

    rows: NDArray[np.int64]
    distances: Float64
    alphas: Float64

    @property
    def weights(self) -> Float64:
        """Share of each Gaussian in what the eye sees: its opacity times the light that those in front let pass."""
        clear = np.concatenate([[1.0], np.cumprod(1.0 - self.alphas)[:-1]])[: len(self.alphas)]
        shares: Float64 = self.alphas * clear
        return shares

    @property
    def opacity(self) -> float:
        """Share of the light that is blocked, 0 to 1."""
        return float(self.weights.sum())

    @property
    def surface(self) -> float | None:
        """Distance at which half of the light is blocked, world units; None where less is blocked in all."""
        blocked = np.cumsum(self.weights)
        if not len(blocked) or blocked[-1] < _MIN_OPACITY:
            return None
        return float(self.distances[np.searchsorted(blocked, _MIN_OPACITY)])


class RayCaster:
    """Casts rays through Gaussians.

    Parameters
    ----------
    gaussians : Gaussians
        Colours are not used.
    """

    def __init__(self, gaussians: Gaussians) -> None:
        self._means = gaussians.means.astype(np.float64)
        self._quats, self._log_scales = gaussians.quats, gaussians.log_scales
        self._opacities = gaussians.opacities.astype(np.float64)
        # The distance from the centre, in standard deviations, at which the opacity falls to the smallest drawn one.
        cutoff = np.sqrt(2.0 * np.log(np.maximum(self._opacities / _ALPHA_MIN, 1.0)))
        self._reach = cutoff * np.exp(gaussians.log_scales.max(axis=1).astype(np.float64))

    def cast(self, origin: NDArray[np.floating], direction: NDArray[np.floating]) -> RayHits:
        """Return what the ray from `origin` [3] along `direction` [3], of any length above 0, meets."""
        unit: Float64 = np.asarray(direction, np.float64) / float(np.linalg.norm(direction))
        offsets = self._means - np.asarray(origin, np.float64)
        along = offsets @ unit
        across = offsets - along[:, None] * unit
        near = np.einsum("ij,ij->i", across, across) < self._reach**2
        rows = np.flatnonzero(near & (along > _NEAREST))
        distances, alphas = self._alphas(rows, offsets[rows], unit)
        # Blended in the order of the centres, as in training.
        order = np.argsort(along[rows], kind="stable")
        order = order[(alphas[order] >= _ALPHA_MIN) & (distances[order] > _NEAREST)]
        return RayHits(rows[order], distances[order], alphas[order])

    def _alphas(self, rows: NDArray[np.int64], offsets: Float64, direction: Float64) -> tuple[Float64, Float64]:
        """Return distance and opacity of Gaussians where their density along the ray is highest, shape [K] each."""
        # In the frame in which a Gaussian is a unit sphere, the ray passes its centre nearest there.
        axes = rotations_from_quats(self._quats[rows]) * np.exp(-self._log_scales[rows].astype(np.float64))[:, None, :]
        centers = np.einsum("ni,nij->nj", offsets, axes)
        directions = np.einsum("i,nij->nj", direction, axes)
        distances = np.einsum("nj,nj->n", centers, directions) / np.einsum("nj,nj->n", directions, directions)
        misses = centers - distances[:, None] * directions
        density = np.exp(-0.5 * np.einsum("nj,nj->n", misses, misses))
        return distances, np.minimum(self._opacities[rows] * density, _ALPHA_MAX)


def photo_ray(camera: Camera, x: float, y: float) -> tuple[Float64, Float64]:
    """Return origin [3] and direction [3] of the ray through a pixel of a photo, in the world.

    Parameters
    ----------
    x, y : float
        Pixels of the photo, after EXIF rotation and with lens distortion.

    Raises
    ------
    CameraError
        When the pixel is outside of the photo, or the lens shows nothing there.
    """
    if not (0.0 <= x < camera.width and 0.0 <= y < camera.height):
        raise CameraError(
            f"The pixel {x:g},{y:g} is outside of {camera.photo}, which has {camera.width} x {camera.height} pixels."
        )
    fx, fy, cx, cy = focal_and_center(camera)
    step = 1.0 / max(fx, fy)
    direction = np.array([(x - cx) / fx, (y - cy) / fy])
    for _ in range(_INVERSION_STEPS):
        # The pixel of the direction, and of two directions a pixel beside it.
        pixels = photo_pixels(camera, direction + np.array([[0, 0], [step, 0], [0, step]]))
        error = pixels[0] - (x, y)
        slopes = (pixels[1:] - pixels[0]).T / step
        if not np.isfinite(slopes).all() or abs(np.linalg.det(slopes)) < 1e-9:
            break
        if math.hypot(*error) < _INVERSION_TOLERANCE:
            local = np.array([*direction, 1.0])
            return camera.center, camera.viewmat[:3, :3].T @ local / np.linalg.norm(local)
        direction = direction - np.linalg.solve(slopes, error)
    raise CameraError(f"The lens of {camera.photo} shows nothing at the pixel {x:g},{y:g}. Choose another pixel.")


def surface_point(caster: RayCaster, camera: Camera, x: float, y: float) -> Point:
    """Return the position in the world of the surface that a photo shows at a pixel.

    Parameters
    ----------
    caster : RayCaster
        Of the Gaussians of the scene.
    camera, x, y
        As for `photo_ray`.

    Raises
    ------
    CameraError
        As `photo_ray`, and when the scene shows nothing there.
    """
    origin, direction = photo_ray(camera, x, y)
    distance = caster.cast(origin, direction).surface
    if distance is None:
        raise CameraError(f"The scene shows no surface at the pixel {x:g},{y:g} of {camera.photo}. Choose another one.")
    point = origin + distance * direction
    return float(point[0]), float(point[1]), float(point[2])
