"""Real spherical harmonics of 3D Gaussian splatting up to band 3, and their gradients, in float64."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .jit import INNER

_C0 = 0.5 / math.sqrt(math.pi)
_C1 = math.sqrt(3.0 / (4.0 * math.pi))
_C2 = 0.5 * math.sqrt(15.0 / math.pi)
_C20 = 0.25 * math.sqrt(5.0 / math.pi)
_C33 = 0.25 * math.sqrt(35.0 / (2.0 * math.pi))
_C32 = 0.5 * math.sqrt(105.0 / math.pi)
_C31 = 0.25 * math.sqrt(21.0 / (2.0 * math.pi))
_C30 = 0.25 * math.sqrt(7.0 / math.pi)


@njit(**INNER)
def sh_basis(x: float, y: float, z: float, degree: int, basis: NDArray[np.float64]) -> None:
    """Write Y_k(x, y, z) of bands 0 to `degree` to `basis` [16]; (x, y, z) has unit length."""
    basis[0] = _C0
    if degree > 0:
        basis[1] = -_C1 * y
        basis[2] = _C1 * z
        basis[3] = -_C1 * x
    if degree > 1:
        basis[4] = _C2 * x * y
        basis[5] = -_C2 * y * z
        basis[6] = _C20 * (2.0 * z * z - x * x - y * y)
        basis[7] = -_C2 * x * z
        basis[8] = 0.5 * _C2 * (x * x - y * y)
    if degree > 2:
        basis[9] = -_C33 * y * (3.0 * x * x - y * y)
        basis[10] = _C32 * x * y * z
        basis[11] = -_C31 * y * (4.0 * z * z - x * x - y * y)
        basis[12] = _C30 * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y)
        basis[13] = -_C31 * x * (4.0 * z * z - x * x - y * y)
        basis[14] = 0.5 * _C32 * z * (x * x - y * y)
        basis[15] = -_C33 * x * (x * x - 3.0 * y * y)


@njit(**INNER)
def sh_basis_gradient(
    x: float, y: float, z: float, degree: int, weights: NDArray[np.float64]
) -> tuple[float, float, float]:
    """Return the gradient of sum_k weights[k] Y_k with respect to (x, y, z), without the constraint of unit length."""
    gx = 0.0
    gy = 0.0
    gz = 0.0
    w = weights
    if degree > 0:
        gy -= _C1 * w[1]
        gz += _C1 * w[2]
        gx -= _C1 * w[3]
    if degree > 1:
        gx += _C2 * y * w[4] - 2.0 * _C20 * x * w[6] - _C2 * z * w[7] + _C2 * x * w[8]
        gy += _C2 * x * w[4] - _C2 * z * w[5] - 2.0 * _C20 * y * w[6] - _C2 * y * w[8]
        gz += -_C2 * y * w[5] + 4.0 * _C20 * z * w[6] - _C2 * x * w[7]
    if degree > 2:
        xx = x * x
        yy = y * y
        zz = z * z
        gx += (
            -6.0 * _C33 * x * y * w[9]
            + _C32 * y * z * w[10]
            + 2.0 * _C31 * x * y * w[11]
            - 6.0 * _C30 * x * z * w[12]
            - _C31 * (4.0 * zz - 3.0 * xx - yy) * w[13]
            + _C32 * x * z * w[14]
            - 3.0 * _C33 * (xx - yy) * w[15]
        )
        gy += (
            -3.0 * _C33 * (xx - yy) * w[9]
            + _C32 * x * z * w[10]
            - _C31 * (4.0 * zz - xx - 3.0 * yy) * w[11]
            - 6.0 * _C30 * y * z * w[12]
            + 2.0 * _C31 * x * y * w[13]
            - _C32 * y * z * w[14]
            + 6.0 * _C33 * x * y * w[15]
        )
        gz += (
            _C32 * x * y * w[10]
            - 8.0 * _C31 * y * z * w[11]
            + 3.0 * _C30 * (2.0 * zz - xx - yy) * w[12]
            - 8.0 * _C31 * x * z * w[13]
            + 0.5 * _C32 * (xx - yy) * w[14]
        )
    return gx, gy, gz
