"""Gaussians in the world -> ellipses on the screen, forward. Scalar float64 inside, float32 in and out.

With M = J W R S (J: affine approximation of the projection, W: world to camera, R S: rotation and scales)::

    Sigma = M M^T + low_pass I                            (Zwicker et al. 2001, EWA)
    det   = |m_x cross m_y|^2 + low_pass (trace of M M^T) + low_pass^2      (Cauchy-Binet: no cancellation for needles)
    alpha = faded 2^-(u^2 + v^2),   u = a dx + b dy,   v = c dy

where (a, b; 0, c) is the upper triangular root of Sigma^-1 log2(e)/2. Working with u and v instead of Sigma^-1 keeps
float32 exact for needles, whose Sigma^-1 dx^2 terms cancel, and never gives a negative exponent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..scene import PinholeCamera
from .finite import rows_finite
from .jit import INNER, JIT
from .settings import ALPHA_MIN, COV_MAX, DET_MIN, JACOBIAN_MARGIN, QUAT_NORM2_MIN, RasterSettings
from .spherical_harmonics import sh_basis
from .threads import Share, take
from .tile_spans import ROWS_KEPT, walk_tiles

__all__ = [
    "CULLED_DEGENERATE",
    "CULLED_NEAR",
    "CULLED_OUTSIDE",
    "CULLED_TRANSPARENT",
    "GAUSSIANS_AT_ONCE",
    "ROOT_SCALE",
    "VISIBLE",
    "Projected",
    "camera_numbers",
    "camera_point",
    "covariance",
    "linearise",
    "project_gaussians",
    "rotation_matrix",
    "screen_axes",
]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

VISIBLE, CULLED_NEAR, CULLED_DEGENERATE, CULLED_TRANSPARENT, CULLED_OUTSIDE = 0, 1, 2, 3, 4

ROOT_SCALE = math.sqrt(0.5 / math.log(2.0))
"""u and v are measured so that alpha is a power of two: sqrt(log2(e) / 2) times the whitened distance."""

GAUSSIANS_AT_ONCE = 512
"""Neighbours that one thread takes together."""


def camera_numbers(camera: PinholeCamera, settings: RasterSettings) -> Float64:
    """Return what the projection needs of a camera in one array.

    0-8 rotation (row major), 9-11 translation, 12-15 fx fy cx cy, 16-19 bounds of x/z and y/z where the projection
    is linearised (low x, high x, low y, high y), 20 near plane, 21 low pass, 22 whether antialiased.
    """
    fx, fy, cx, cy = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
    margin_x, margin_y = JACOBIAN_MARGIN * camera.width, JACOBIAN_MARGIN * camera.height
    numbers = np.zeros(23)
    numbers[0:9] = np.asarray(camera.viewmat)[:3, :3].reshape(-1)
    numbers[9:12] = np.asarray(camera.viewmat)[:3, 3]
    numbers[12:16] = fx, fy, cx, cy
    numbers[16:18] = (-margin_x - cx) / fx, (camera.width + margin_x - cx) / fx
    numbers[18:20] = (-margin_y - cy) / fy, (camera.height + margin_y - cy) / fy
    numbers[20:23] = settings.near, settings.low_pass, settings.antialiased
    return numbers


@dataclass(frozen=True)
class Projected:
    """What the projection leaves for each of N Gaussians; rows of culled ones are undefined but for `state`.

    Attributes
    ----------
    state : uint8 [N]
        ``VISIBLE`` or why it was culled.
    pixels : float64 [N, 2]
        Centre on the screen.
    roots : float64 [N, 3]
        a, b, c: alpha = faded 2^-((a dx + b dy)^2 + (c dy)^2).
    faded : float32 [N]
        Opacity on the screen: the Gaussian's own, less when antialiased.
    limits : float32 [N]
        log2(255 faded): alpha is at least 1/255 where u^2 + v^2 is at most this.
    depths : float32 [N]
        Distance from the camera plane.
    radii : float32 [N]
        Three standard deviations along the longer axis, pixels; 0 when culled.
    colors : float32 [N, K4]
        What is blended; K rounded up to a multiple of 4 with zeros.
    n_tiles : int32 [N]
        How many 16x16 tiles the ellipse touches; 0 when culled.
    spans : uint16 [N, 2 + 2 ROWS_KEPT]
        Which, see `walk_tiles`.
    """

    state: NDArray[np.uint8]
    pixels: Float64
    roots: Float64
    faded: Float32
    limits: Float32
    depths: Float32
    radii: Float32
    colors: Float32
    n_tiles: NDArray[np.int32]
    spans: NDArray[np.uint16]

    @classmethod
    def empty(cls, n: int, n_colors: int) -> Projected:
        """Return room for `n` Gaussians and `n_colors` (a multiple of 4) values each."""
        return cls(
            np.empty(n, np.uint8),
            np.empty((n, 2), np.float64),
            np.empty((n, 3), np.float64),
            np.empty(n, np.float32),
            np.empty(n, np.float32),
            np.empty(n, np.float32),
            np.zeros(n, np.float32),
            np.empty((n, n_colors), np.float32),
            np.zeros(n, np.int32),
            np.empty((n, 2 + 2 * ROWS_KEPT), np.uint16),
        )


@njit(**INNER)
def rotation_matrix(w: float, x: float, y: float, z: float, r: Float64) -> None:
    """Write the rotation of the unit quaternion wxyz into `r` [3, 3]."""
    r[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    r[0, 1] = 2.0 * (x * y - w * z)
    r[0, 2] = 2.0 * (x * z + w * y)
    r[1, 0] = 2.0 * (x * y + w * z)
    r[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    r[1, 2] = 2.0 * (y * z - w * x)
    r[2, 0] = 2.0 * (x * z - w * y)
    r[2, 1] = 2.0 * (y * z + w * x)
    r[2, 2] = 1.0 - 2.0 * (x * x + y * y)


@njit(**INNER)
def camera_point(g: int, means: Float32, camera: Float64) -> tuple[float, float, float]:
    """Return the mean of Gaussian `g` in the camera: x right, y down, z forward."""
    x = np.float64(means[g, 0])
    y = np.float64(means[g, 1])
    z = np.float64(means[g, 2])
    return (
        camera[0] * x + camera[1] * y + camera[2] * z + camera[9],
        camera[3] * x + camera[4] * y + camera[5] * z + camera[10],
        camera[6] * x + camera[7] * y + camera[8] * z + camera[11],
    )


@njit(**INNER)
def linearise(x: float, y: float, z: float, camera: Float64, q: Float64) -> tuple[float, float]:
    """Write Q = J W into `q` [2, 3] and return (x/z, y/z) where J is taken: held within the camera's bounds."""
    tan_x = min(max(x / z, camera[16]), camera[17])
    tan_y = min(max(y / z, camera[18]), camera[19])
    for k in range(3):
        q[0, k] = camera[12] / z * (camera[k] - tan_x * camera[6 + k])
        q[1, k] = camera[13] / z * (camera[3 + k] - tan_y * camera[6 + k])
    return tan_x, tan_y


@njit(**INNER)
def screen_axes(g: int, scales: Float32, r: Float64, q: Float64, m: Float64) -> None:
    """Write M = Q R S into `m` [2, 3]: columns are the Gaussian's axes on the screen, pixels."""
    for k in range(3):
        s = np.float64(scales[g, k])
        m[0, k] = (q[0, 0] * r[0, k] + q[0, 1] * r[1, k] + q[0, 2] * r[2, k]) * s
        m[1, k] = (q[1, 0] * r[0, k] + q[1, 1] * r[1, k] + q[1, 2] * r[2, k]) * s


@njit(**INNER)
def covariance(m: Float64) -> tuple[float, float, float, float, float, float]:
    """Return M M^T as xx, xy, yy, and the cross product of the rows of M, whose square is its determinant."""
    xx = m[0, 0] * m[0, 0] + m[0, 1] * m[0, 1] + m[0, 2] * m[0, 2]
    xy = m[0, 0] * m[1, 0] + m[0, 1] * m[1, 1] + m[0, 2] * m[1, 2]
    yy = m[1, 0] * m[1, 0] + m[1, 1] * m[1, 1] + m[1, 2] * m[1, 2]
    c0 = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    c1 = m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2]
    c2 = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    return xx, xy, yy, c0, c1, c2


@njit(**INNER)
def _project_one(
    g: int,
    means: Float32,
    quats: Float32,
    scales: Float32,
    opacities: Float32,
    camera: Float64,
    width: int,
    height: int,
    r: Float64,
    q: Float64,
    m: Float64,
    pixels: Float64,
    roots: Float64,
    faded: Float32,
    limits: Float32,
    depths: Float32,
    radii: Float32,
    n_tiles: NDArray[np.int32],
    spans: NDArray[np.uint16],
) -> int:
    """Project Gaussian `g` and return its state. `r` [3, 3], `q` [2, 3], `m` [2, 3] are scratch."""
    x, y, z = camera_point(g, means, camera)
    if not z > camera[20]:
        return CULLED_NEAR
    qw = np.float64(quats[g, 0])
    qx = np.float64(quats[g, 1])
    qy = np.float64(quats[g, 2])
    qz = np.float64(quats[g, 3])
    norm2 = qw * qw + qx * qx + qy * qy + qz * qz
    if norm2 < QUAT_NORM2_MIN:
        return CULLED_DEGENERATE
    k = 1.0 / math.sqrt(norm2)
    rotation_matrix(qw * k, qx * k, qy * k, qz * k, r)
    linearise(x, y, z, camera, q)
    screen_axes(g, scales, r, q, m)
    xx, xy, yy, c0, c1, c2 = covariance(m)
    low_pass = camera[21]
    det_alone = c0 * c0 + c1 * c1 + c2 * c2
    det = det_alone + low_pass * (xx + yy + low_pass)
    xx += low_pass
    yy += low_pass
    if not (det >= DET_MIN and max(xx, yy) <= COV_MAX):
        return CULLED_DEGENERATE
    opacity = np.float64(opacities[g])
    if camera[22] > 0.0:
        opacity *= math.sqrt(det_alone / det)
    if opacity < ALPHA_MIN:
        return CULLED_TRANSPARENT
    limit = math.log2(255.0 * opacity)
    px = camera[12] / z * x + camera[14]
    py = camera[13] / z * y + camera[15]
    reach = 2.0 * math.log(2.0) * max(limit, 0.0)
    extent_x = math.sqrt(reach * xx)
    extent_y = math.sqrt(reach * yy)
    if px + extent_x < 0.5 or px - extent_x > width - 0.5 or py + extent_y < 0.5 or py - extent_y > height - 0.5:
        return CULLED_OUTSIDE
    a = ROOT_SCALE * math.sqrt(yy / det)
    roots[g, 0] = a
    roots[g, 1] = -a * xy / yy
    roots[g, 2] = ROOT_SCALE / math.sqrt(yy)
    pixels[g, 0] = px
    pixels[g, 1] = py
    faded[g] = opacity
    limits[g] = limit
    depths[g] = z
    radii[g] = 3.0 * math.sqrt(0.5 * (xx + yy) + math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy))
    n_tiles[g] = walk_tiles(
        px, py, roots[g, 0], roots[g, 1], roots[g, 2], limits[g], width, height, spans, g, False, 0, n_tiles
    )  # fmt: skip
    return VISIBLE


@njit(**JIT)
def project_gaussians(
    share: Share,
    means: Float32,
    quats: Float32,
    scales: Float32,
    opacities: Float32,
    sh: Float32,
    sh_degree: int,
    channels: Float32,
    camera: Float64,
    center: Float64,
    width: int,
    height: int,
    state: NDArray[np.uint8],
    pixels: Float64,
    roots: Float64,
    faded: Float32,
    limits: Float32,
    depths: Float32,
    radii: Float32,
    colors: Float32,
    n_tiles: NDArray[np.int32],
    spans: NDArray[np.uint16],
) -> int:
    """Project this thread's share of the Gaussians and fill their rows of `Projected`.

    Returns how often it met a value that is not finite; where it did, nothing is projected.

    `sh` [N, n_sh, 3] has n_sh = 0 when there are no colours, `channels` [N, C] has C = 0 when there are none.
    colour = max(0, 0.5 + sum_k sh_k Y_k(direction)), direction from the camera's `center` to the mean.
    """
    r = np.empty((3, 3), np.float64)
    q = np.empty((2, 3), np.float64)
    m = np.empty((2, 3), np.float64)
    basis = np.empty(16, np.float64)
    n_basis = (sh_degree + 1) * (sh_degree + 1)
    n_rgb = 3 if sh.shape[1] > 0 else 0
    n_channels = channels.shape[1]
    n = means.shape[0]
    n_bad = 0
    first, last = take(share, n, GAUSSIANS_AT_ONCE)
    while first < last:
        if not rows_finite(first, last, means, quats, scales, opacities, sh, channels):
            n_bad += 1
            last = first
        for g in range(first, last):
            state[g] = _project_one(
                g, means, quats, scales, opacities, camera, width, height, r, q, m, pixels, roots, faded, limits, depths,
                radii, n_tiles, spans,
            )  # fmt: skip
            if state[g] != VISIBLE:
                continue
            if n_rgb > 0:
                dx = means[g, 0] - center[0]
                dy = means[g, 1] - center[1]
                dz = means[g, 2] - center[2]
                k = 1.0 / max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-30)
                sh_basis(dx * k, dy * k, dz * k, sh_degree, basis)
                red = 0.5
                green = 0.5
                blue = 0.5
                for i in range(n_basis):
                    red += basis[i] * sh[g, i, 0]
                    green += basis[i] * sh[g, i, 1]
                    blue += basis[i] * sh[g, i, 2]
                colors[g, 0] = max(red, 0.0)
                colors[g, 1] = max(green, 0.0)
                colors[g, 2] = max(blue, 0.0)
            for i in range(n_channels):
                colors[g, n_rgb + i] = channels[g, i]
            for i in range(n_rgb + n_channels, colors.shape[1]):
                colors[g, i] = 0.0
        first, last = take(share, n, GAUSSIANS_AT_ONCE)
    return n_bad
