"""Backward pass of the projection, from the gradients of pairs of a tile and a Gaussian to those of the parameters.

The moments S = sum s, s (U, V), s (U, V)(U, V)^T of `blend_backward`, with w = (U, V) = L d the whitened distance and
Sigma^-1 = L^T L, give without cancellation (the derivative of ln alpha = ln opacity - |w|^2 / 2)::

    dL/dopacity = S_1 / opacity,   dL/dcentre = L^T S_w,   dL/dSigma = L^T S_ww L / 2

then through Sigma = M M^T + low_pass I, M = J W R S: dL/dM = 2 dL/dSigma M, and the product rule. The gradient of J
is zero where the point of linearisation was clamped.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..core.arrays import Float32, Float64
from .blend_backward import MOMENTS_SIZE
from .blend_forward import PREFETCH_DISTANCE
from .finite import rows_finite
from .jit import INNER, JIT
from .projection import (
    FX,
    FY,
    GAUSSIANS_PER_RANGE,
    LOW_PASS,
    ROOT_SCALE,
    TAN_X_MAX,
    TAN_X_MIN,
    TAN_Y_MAX,
    TAN_Y_MIN,
    VISIBLE,
    camera_point,
    covariance,
    linearise,
    rotation_matrix,
    screen_axes,
    viewing_direction,
)
from .simd import item, prefetch
from .spherical_harmonics import sh_basis, sh_basis_gradient
from .threads import Share, take_range


@njit(**INNER)
def _quaternion_gradient(
    w: float, x: float, y: float, z: float, norm: float, d: Float64
) -> tuple[float, float, float, float]:
    """Return dL/dq of a quaternion of length `norm` from dL/dR = `d` [3, 3]; wxyz is the unit quaternion."""
    gw = 2.0 * (x * (d[2, 1] - d[1, 2]) + y * (d[0, 2] - d[2, 0]) + z * (d[1, 0] - d[0, 1]))
    gx = 2.0 * (
        -2.0 * x * (d[1, 1] + d[2, 2]) + y * (d[0, 1] + d[1, 0]) + z * (d[0, 2] + d[2, 0]) + w * (d[2, 1] - d[1, 2])
    )
    gy = 2.0 * (
        x * (d[0, 1] + d[1, 0]) - 2.0 * y * (d[0, 0] + d[2, 2]) + z * (d[1, 2] + d[2, 1]) + w * (d[0, 2] - d[2, 0])
    )
    gz = 2.0 * (
        x * (d[0, 2] + d[2, 0]) + y * (d[1, 2] + d[2, 1]) - 2.0 * z * (d[0, 0] + d[1, 1]) + w * (d[1, 0] - d[0, 1])
    )
    along = gw * w + gx * x + gy * y + gz * z
    return (gw - along * w) / norm, (gx - along * x) / norm, (gy - along * y) / norm, (gz - along * z) / norm


@njit(**JIT)
def project_gaussians_backward(
    share: Share,
    state: NDArray[np.uint8],
    pair_start: NDArray[np.int64],
    list_positions: NDArray[np.int32],
    pair_gradients: Float32,
    means: Float32,
    quats: Float32,
    scales: Float32,
    opacities: Float32,
    sh: Float32,
    sh_degree: int,
    camera: Float64,
    center: Float64,
    colors: Float32,
    n_channels: int,
    means_gradient: Float32,
    quats_gradient: Float32,
    scales_gradient: Float32,
    opacities_gradient: Float32,
    sh_gradient: Float32,
    channels_gradient: Float32,
    pose_gradients: Float64,
) -> int:
    """Fill the gradients of this thread's share of the Gaussians, zero for those that are not visible.

    Returns in how many ranges of Gaussians a gradient other than that of the pose is not finite.

    `pose_gradients` [N, 12] gets each Gaussian's part of dL/dW (row major) and dL/dt of world-to-camera x = W X + t; it
    is [0, 12] if no gradient of the pose is needed.
    `pair_gradients` is flat [M (MOMENTS_SIZE + n_colors)], in the order of the tiles' lists. `list_positions` [M] gives
    the row of each pair. The rows of a Gaussian's pairs are summed in the order of the pairs, in float64.
    """
    zero = np.float32(0.0)
    row_length = MOMENTS_SIZE + colors.shape[1]
    n_rgb = 3 if sh.shape[1] > 0 else 0
    n_basis = (sh_degree + 1) * (sh_degree + 1)
    total = np.empty(row_length, np.float64)
    basis = np.empty(16, np.float64)
    weights = np.empty(16, np.float64)
    r = np.empty((3, 3), np.float64)
    d = np.empty((3, 3), np.float64)
    q = np.empty((2, 3), np.float64)
    m = np.empty((2, 3), np.float64)
    lm = np.empty((2, 3), np.float64)
    d_m = np.empty((2, 3), np.float64)
    d_q = np.empty((2, 3), np.float64)
    n = state.shape[0]
    n_bad = 0
    first, last = take_range(share, n, GAUSSIANS_PER_RANGE)
    while first < last:
        for g in range(first, last):
            means_gradient[g] = zero
            quats_gradient[g] = zero
            scales_gradient[g] = zero
            opacities_gradient[g] = zero
            sh_gradient[g] = zero
            channels_gradient[g] = zero
            if state[g] != VISIBLE:
                continue
            total[:] = 0.0
            for pair in range(pair_start[g], pair_start[g + 1]):
                pair_ahead = min(pair + PREFETCH_DISTANCE, list_positions.shape[0] - 1)
                ahead = np.int64(list_positions[pair_ahead]) * row_length
                for k in range(0, row_length + 15, 16):
                    prefetch(pair_gradients, ahead + k)
                row = np.int64(list_positions[pair]) * row_length
                for k in range(row_length):
                    total[k] += item(pair_gradients, row + k)
            for k in range(n_channels):
                channels_gradient[g, k] = total[MOMENTS_SIZE + n_rgb + k]
            opacities_gradient[g] = total[0] / opacities[g]

            # Compute the projection again.
            x, y, z = camera_point(g, means, camera)
            qw = np.float64(quats[g, 0])
            qx = np.float64(quats[g, 1])
            qy = np.float64(quats[g, 2])
            qz = np.float64(quats[g, 3])
            norm = math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
            qw /= norm
            qx /= norm
            qy /= norm
            qz /= norm
            rotation_matrix(qw, qx, qy, qz, r)
            fx_z = camera[FX] / z
            fy_z = camera[FY] / z
            tan_x, tan_y = linearise(x, y, z, camera, q)
            screen_axes(g, scales, r, q, m)
            # The ellipse in float64. The entries of L M are at most 1, even if those of L and M are far from 1, so the
            # float32 roots that blending uses would lose all digits of L M for a needle-shaped Gaussian.
            xx, xy, yy, c0, c1, c2 = covariance(m)
            low_pass = camera[LOW_PASS]
            det = c0 * c0 + c1 * c1 + c2 * c2 + low_pass * (xx + yy + low_pass)
            yy += low_pass
            a = math.sqrt(yy / det)
            b = -a * xy / yy
            c = 1.0 / math.sqrt(yy)
            s_u = total[1] / ROOT_SCALE
            s_v = total[2] / ROOT_SCALE
            scale2 = ROOT_SCALE * ROOT_SCALE
            s_uu = total[3] / scale2
            s_uv = total[4] / scale2
            s_vv = total[5] / scale2
            d_px = a * s_u
            d_py = b * s_u + c * s_v
            # d_m = 2 dL/dSigma M = L^T S_ww (L M). The first row of L M is a m0 + b m1 = a / yy (yy m0 - xy m1), here
            # written without cancellation.
            lean = a / yy
            lm[0, 0] = lean * (low_pass * m[0, 0] + m[1, 1] * c2 - m[1, 2] * c1)
            lm[0, 1] = lean * (low_pass * m[0, 1] + m[1, 2] * c0 - m[1, 0] * c2)
            lm[0, 2] = lean * (low_pass * m[0, 2] + m[1, 0] * c1 - m[1, 1] * c0)
            for k in range(3):
                lm[1, k] = c * m[1, k]
                d_u = s_uu * lm[0, k] + s_uv * lm[1, k]
                d_v = s_uv * lm[0, k] + s_vv * lm[1, k]
                d_m[0, k] = a * d_u
                d_m[1, k] = b * d_u + c * d_v
            for k in range(3):
                s = np.float64(scales[g, k])
                along = 0.0
                for j in range(3):
                    d_v = q[0, j] * d_m[0, k] + q[1, j] * d_m[1, k]
                    along += d_v * r[j, k]
                    d[j, k] = d_v * s
                scales_gradient[g, k] = along
            gw, gx, gy, gz = _quaternion_gradient(qw, qx, qy, qz, norm, d)
            quats_gradient[g, 0] = gw
            quats_gradient[g, 1] = gx
            quats_gradient[g, 2] = gy
            quats_gradient[g, 3] = gz
            for j in range(3):
                d_q[0, j] = 0.0
                d_q[1, j] = 0.0
                for k in range(3):
                    v = r[j, k] * scales[g, k]
                    d_q[0, j] += d_m[0, k] * v
                    d_q[1, j] += d_m[1, k] * v
            # Q = J W with J = (fx/z, 0, -tan_x fx/z; 0, fy/z, -tan_y fy/z)
            j00 = 0.0
            j02 = 0.0
            j11 = 0.0
            j12 = 0.0
            for j in range(3):
                j00 += d_q[0, j] * camera[j]
                j02 += d_q[0, j] * camera[6 + j]
                j11 += d_q[1, j] * camera[3 + j]
                j12 += d_q[1, j] * camera[6 + j]
            d_x = d_px * fx_z
            d_y = d_py * fy_z
            d_z = -(d_x * x + d_y * y) / z
            d_z -= (fx_z * (j00 - tan_x * j02) + fy_z * (j11 - tan_y * j12)) / z
            if camera[TAN_X_MIN] <= x / z <= camera[TAN_X_MAX]:
                d_x -= fx_z * j02 / z
                d_z += fx_z * j02 * x / (z * z)
            if camera[TAN_Y_MIN] <= y / z <= camera[TAN_Y_MAX]:
                d_y -= fy_z * j12 / z
                d_z += fy_z * j12 * y / (z * z)
            if pose_gradients.shape[0] > 0:
                for j in range(3):
                    mean = np.float64(means[g, j])
                    pose_gradients[g, j] = d_x * mean + fx_z * d_q[0, j]
                    pose_gradients[g, 3 + j] = d_y * mean + fy_z * d_q[1, j]
                    pose_gradients[g, 6 + j] = d_z * mean - tan_x * fx_z * d_q[0, j] - tan_y * fy_z * d_q[1, j]
                pose_gradients[g, 9] = d_x
                pose_gradients[g, 10] = d_y
                pose_gradients[g, 11] = d_z
            d_x0 = camera[0] * d_x + camera[3] * d_y + camera[6] * d_z
            d_y0 = camera[1] * d_x + camera[4] * d_y + camera[7] * d_z
            d_z0 = camera[2] * d_x + camera[5] * d_y + camera[8] * d_z

            # Colours.
            if n_rgb > 0:
                x, y, z, inverse_distance = viewing_direction(g, means, center)
                sh_basis(x, y, z, sh_degree, basis)
                red = total[MOMENTS_SIZE] if colors[g, 0] > 0.0 else 0.0
                green = total[MOMENTS_SIZE + 1] if colors[g, 1] > 0.0 else 0.0
                blue = total[MOMENTS_SIZE + 2] if colors[g, 2] > 0.0 else 0.0
                for k in range(n_basis):
                    sh_gradient[g, k, 0] = basis[k] * red
                    sh_gradient[g, k, 1] = basis[k] * green
                    sh_gradient[g, k, 2] = basis[k] * blue
                    weights[k] = sh[g, k, 0] * red + sh[g, k, 1] * green + sh[g, k, 2] * blue
                gx, gy, gz = sh_basis_gradient(x, y, z, sh_degree, weights)
                along = gx * x + gy * y + gz * z
                gx = (gx - along * x) * inverse_distance
                gy = (gy - along * y) * inverse_distance
                gz = (gz - along * z) * inverse_distance
                d_x0 += gx
                d_y0 += gy
                d_z0 += gz
                if pose_gradients.shape[0] > 0:
                    # The viewing direction starts at the camera's centre -W^T t.
                    for i in range(3):
                        t = camera[9 + i]
                        pose_gradients[g, 3 * i] += t * gx
                        pose_gradients[g, 3 * i + 1] += t * gy
                        pose_gradients[g, 3 * i + 2] += t * gz
                        pose_gradients[g, 9 + i] += camera[3 * i] * gx + camera[3 * i + 1] * gy + camera[3 * i + 2] * gz
            means_gradient[g, 0] = d_x0
            means_gradient[g, 1] = d_y0
            means_gradient[g, 2] = d_z0
        n_bad += not rows_finite(
            first, last, means_gradient, quats_gradient, scales_gradient, opacities_gradient, sh_gradient,
            channels_gradient,
        )  # fmt: skip
        first, last = take_range(share, n, GAUSSIANS_PER_RANGE)
    return n_bad
