"""Forward pass of the projection of Gaussians to ellipses on the screen. It computes in float64, with float32 inputs.

With M = J W R S (J: affine approximation of the projection, W: world to camera, R S: rotation and scales)::

    Sigma = M M^T + low_pass I                            (Zwicker et al. 2001, EWA)
    det   = |m_x cross m_y|^2 + low_pass (trace of M M^T) + low_pass^2      (Cauchy-Binet: no cancellation for needles)
    alpha = opacity 2^-(u^2 + v^2),   u = a dx + b dy,   v = c dy

where (a, b; 0, c) is the upper triangular root of Sigma^-1 log2(e)/2. The terms of d^T Sigma^-1 d cancel for
needle-shaped Gaussians; a sum of two squares stays exact in float32 and is never negative.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..core.arrays import Float32, Float64
from ..scene import PinholeCamera
from .finite import rows_finite
from .jit import INNER, JIT
from .settings import (
    ALPHA_MIN,
    COV_MAX,
    DET_MIN,
    DIRECTION_NORM_MIN,
    INVERSE_ALPHA_MIN,
    JACOBIAN_MARGIN,
    QUAT_NORM2_MIN,
    RADIUS_SIGMAS,
    RasterSettings,
)
from .spherical_harmonics import sh_basis
from .threads import Share, take_range
from .tile_spans import MAX_STORED_ROWS, walk_tiles

VISIBLE, CULLED_NEAR, CULLED_DEGENERATE, CULLED_TRANSPARENT, CULLED_OUTSIDE = 0, 1, 2, 3, 4
"""States of a Gaussian: visible, or the reason why it was culled, see `CulledCounts`."""

FX, FY, CX, CY = 12, 13, 14, 15
"""Indices of the intrinsics in a packed camera, see `pack_camera`."""

TAN_X_MIN, TAN_X_MAX, TAN_Y_MIN, TAN_Y_MAX = 16, 17, 18, 19
"""Indices in a packed camera of the bounds of x/z and y/z where the projection is linearised."""

NEAR, LOW_PASS, ANTIALIASED = 20, 21, 22
"""Indices in a packed camera of the settings."""

ROOT_SCALE = math.sqrt(0.5 / math.log(2.0))
"""Unit of u and v: sqrt(log2(e) / 2) times the whitened distance. With it, alpha is a power of two, see above."""

GAUSSIANS_PER_RANGE = 512
"""Number of neighbouring Gaussians that a thread takes together."""


def pack_camera(camera: PinholeCamera, settings: RasterSettings) -> Float64:
    """Return the camera and settings that the projection kernels need in one float64 array of shape [23].

    Entries 0 to 8 are the rotation (row major) and 9 to 11 the translation of world-to-camera. `FX` to `ANTIALIASED`
    are the indices of the other entries.
    """
    fx, fy, cx, cy = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
    margin_x, margin_y = JACOBIAN_MARGIN * camera.width, JACOBIAN_MARGIN * camera.height
    packed = np.zeros(23)
    packed[0:9] = np.asarray(camera.viewmat)[:3, :3].reshape(-1)
    packed[9:12] = np.asarray(camera.viewmat)[:3, 3]
    packed[FX : CY + 1] = fx, fy, cx, cy
    packed[TAN_X_MIN : TAN_X_MAX + 1] = (-margin_x - cx) / fx, (camera.width + margin_x - cx) / fx
    packed[TAN_Y_MIN : TAN_Y_MAX + 1] = (-margin_y - cy) / fy, (camera.height + margin_y - cy) / fy
    packed[NEAR : ANTIALIASED + 1] = settings.near, settings.low_pass, settings.antialiased
    return packed


@dataclass(frozen=True)
class Projected:
    """The projections of N Gaussians. Rows of culled ones are undefined except for `state`, `radii` and `n_tiles`.

    Attributes
    ----------
    state : uint8 [N]
        `VISIBLE`, or the reason why the Gaussian was culled.
    pixels : float64 [N, 2]
        Centre on the screen, pixels.
    roots : float64 [N, 3]
        a, b, c with alpha = opacity 2^-((a dx + b dy)^2 + (c dy)^2).
    screen_opacities : float32 [N]
        Opacity on the screen: that of the Gaussian, reduced if antialiased.
    limits : float32 [N]
        log2(255 opacity) with the opacity on the screen: alpha is at least 1/255 where u^2 + v^2 is at most this.
    depths : float32 [N]
        Distance from the camera plane.
    radii : float32 [N]
        Three standard deviations along the longer axis, pixels; 0 if culled.
    colors : float32 [N, K4]
        Values to blend; K is rounded up to a multiple of 4 with zeros.
    n_tiles : int32 [N]
        Number of 16x16 tiles that the ellipse touches; 0 if culled.
    spans : uint16 [N, 2 + 2 MAX_STORED_ROWS]
        The tiles, see `walk_tiles`.
    """

    state: NDArray[np.uint8]
    pixels: Float64
    roots: Float64
    screen_opacities: Float32
    limits: Float32
    depths: Float32
    radii: Float32
    colors: Float32
    n_tiles: NDArray[np.int32]
    spans: NDArray[np.uint16]

    @classmethod
    def empty(cls, n: int, n_colors: int) -> Projected:
        """Return arrays for `n` Gaussians with `n_colors` values each, a multiple of 4."""
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
            np.empty((n, 2 + 2 * MAX_STORED_ROWS), np.uint16),
        )


@njit(**INNER)
def rotation_matrix(w: float, x: float, y: float, z: float, r: Float64) -> None:
    """Write the rotation matrix of the unit quaternion wxyz to `r` [3, 3]."""
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
    """Return the mean of Gaussian `g` in camera space: x right, y down, z forward. `camera` holds R, then t at 9."""
    x = np.float64(means[g, 0])
    y = np.float64(means[g, 1])
    z = np.float64(means[g, 2])
    return (
        camera[0] * x + camera[1] * y + camera[2] * z + camera[9],
        camera[3] * x + camera[4] * y + camera[5] * z + camera[10],
        camera[6] * x + camera[7] * y + camera[8] * z + camera[11],
    )


@njit(**INNER)
def viewing_direction(g: int, means: Float32, center: Float64) -> tuple[float, float, float, float]:
    """Return the unit vector x, y, z from the camera's `center` [3] to Gaussian `g`, and the inverse distance."""
    x = means[g, 0] - center[0]
    y = means[g, 1] - center[1]
    z = means[g, 2] - center[2]
    inverse_distance = 1.0 / max(math.sqrt(x * x + y * y + z * z), DIRECTION_NORM_MIN)
    return x * inverse_distance, y * inverse_distance, z * inverse_distance, inverse_distance


@njit(**INNER)
def linearise(x: float, y: float, z: float, camera: Float64, q: Float64) -> tuple[float, float]:
    """Write Q = J W to `q` [2, 3], with J taken at (x/z, y/z) clamped to the camera's bounds; return that point."""
    tan_x = min(max(x / z, camera[TAN_X_MIN]), camera[TAN_X_MAX])
    tan_y = min(max(y / z, camera[TAN_Y_MIN]), camera[TAN_Y_MAX])
    for k in range(3):
        q[0, k] = camera[FX] / z * (camera[k] - tan_x * camera[6 + k])
        q[1, k] = camera[FY] / z * (camera[3 + k] - tan_y * camera[6 + k])
    return tan_x, tan_y


@njit(**INNER)
def screen_axes(g: int, scales: Float32, r: Float64, q: Float64, m: Float64) -> None:
    """Write M = Q R S to `m` [2, 3]. Its columns are the axes of the Gaussian on the screen, in pixels."""
    for k in range(3):
        s = np.float64(scales[g, k])
        m[0, k] = (q[0, 0] * r[0, k] + q[0, 1] * r[1, k] + q[0, 2] * r[2, k]) * s
        m[1, k] = (q[1, 0] * r[0, k] + q[1, 1] * r[1, k] + q[1, 2] * r[2, k]) * s


@njit(**INNER)
def covariance(m: Float64) -> tuple[float, float, float, float, float, float]:
    """Return xx, xy, yy of M M^T for M [2, 3], and the cross product of the rows of M, whose squared length is the determinant."""
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
    screen_opacities: Float32,
    limits: Float32,
    depths: Float32,
    radii: Float32,
    n_tiles: NDArray[np.int32],
    spans: NDArray[np.uint16],
) -> int:
    """Project Gaussian `g` and return its state. `r` [3, 3], `q` [2, 3], `m` [2, 3] are scratch."""
    x, y, z = camera_point(g, means, camera)
    if not z > camera[NEAR]:
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
    low_pass = camera[LOW_PASS]
    det_alone = c0 * c0 + c1 * c1 + c2 * c2
    det = det_alone + low_pass * (xx + yy + low_pass)
    xx += low_pass
    yy += low_pass
    if not (det >= DET_MIN and max(xx, yy) <= COV_MAX):
        return CULLED_DEGENERATE
    opacity = np.float64(opacities[g])
    if camera[ANTIALIASED] > 0.0:
        opacity *= math.sqrt(det_alone / det)
    if opacity < ALPHA_MIN:
        return CULLED_TRANSPARENT
    limit = math.log2(INVERSE_ALPHA_MIN * opacity)
    px = camera[FX] / z * x + camera[CX]
    py = camera[FY] / z * y + camera[CY]
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
    screen_opacities[g] = opacity
    limits[g] = limit
    depths[g] = z
    radii[g] = RADIUS_SIGMAS * math.sqrt(0.5 * (xx + yy) + math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy))
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
    screen_opacities: Float32,
    limits: Float32,
    depths: Float32,
    radii: Float32,
    colors: Float32,
    n_tiles: NDArray[np.int32],
    spans: NDArray[np.uint16],
) -> int:
    """Project this thread's share of the Gaussians and fill their rows of the arrays of `Projected`.

    Returns in how many ranges of Gaussians an input is not finite; these ranges are not projected.

    `sh` [N, n_sh, 3] has n_sh = 0 without colours, and `channels` [N, C] has C = 0 without channels.
    colour = max(0, 0.5 + sum_k sh_k Y_k(direction)), with the direction from the camera's `center` to the mean.
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
    first, last = take_range(share, n, GAUSSIANS_PER_RANGE)
    while first < last:
        if not rows_finite(first, last, means, quats, scales, opacities, sh, channels):
            n_bad += 1
            last = first
        for g in range(first, last):
            state[g] = _project_one(
                g, means, quats, scales, opacities, camera, width, height, r, q, m, pixels, roots, screen_opacities,
                limits, depths, radii, n_tiles, spans,
            )  # fmt: skip
            if state[g] != VISIBLE:
                continue
            if n_rgb > 0:
                x, y, z, _ = viewing_direction(g, means, center)
                sh_basis(x, y, z, sh_degree, basis)
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
        first, last = take_range(share, n, GAUSSIANS_PER_RANGE)
    return n_bad
