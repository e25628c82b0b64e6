"""The real spherical harmonics of 3D Gaussian splatting, and how their coefficients turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["SH_C0", "orthogonal_sh_matrix", "sh_basis"]

Float64 = NDArray[np.float64]

SH_C0 = 0.28209479177387814
_C1 = 0.4886025119029199
_C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
_C3 = (
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
)


def sh_basis(directions: Float64, degree: int) -> Float64:
    """Return the basis functions at unit `directions`.

    Parameters
    ----------
    directions : array of shape [M, 3], float64
        Unit vectors from the camera to the Gaussian.
    degree : int
        0 to 3.

    Returns
    -------
    array of shape [M, (degree + 1)^2], float64
        Order m = -l..l in each band l, signs as in Kerbl et al. 2023.
    """
    x, y, z = directions.T
    columns = [np.full_like(x, SH_C0)]
    if degree >= 1:
        columns += [-_C1 * y, _C1 * z, -_C1 * x]
    if degree >= 2:
        columns += [
            _C2[0] * x * y,
            _C2[1] * y * z,
            _C2[2] * (2 * z * z - x * x - y * y),
            _C2[3] * x * z,
            _C2[4] * (x * x - y * y),
        ]
    if degree >= 3:
        columns += [
            _C3[0] * y * (3 * x * x - y * y),
            _C3[1] * x * y * z,
            _C3[2] * y * (4 * z * z - x * x - y * y),
            _C3[3] * z * (2 * z * z - 3 * x * x - 3 * y * y),
            _C3[4] * x * (4 * z * z - x * x - y * y),
            _C3[5] * z * (x * x - y * y),
            _C3[6] * x * (x * x - 3 * y * y),
        ]
    return np.stack(columns, axis=1)


def orthogonal_sh_matrix(orthogonal: Float64, degree: int) -> Float64:
    """Return the matrix that turns SH coefficients along with their object.

    Parameters
    ----------
    orthogonal : array of shape [3, 3], float64
        Rotation, or rotation with a reflection.
    degree : int
        0 to 3.

    Returns
    -------
    array of shape [n, n], float64, n = (degree + 1)^2
        ``new = matrix @ old`` per colour channel, so that the new function at ``orthogonal @ d`` is the old
        one at ``d``.

    Notes
    -----
    Each band is closed under orthogonal maps, so sampling more directions than coefficients and solving by
    least
    squares is exact. Over evenly spread directions the basis is nearly orthogonal: the condition number stays
    below 1.5 and the error at a few units of rounding, for every rotation, with no special cases as in the
    recurrences of Ivanic and Ruedenberg 1996.
    """
    directions = _evenly_spread_directions(64)
    before = sh_basis(directions @ orthogonal, degree)
    here = sh_basis(directions, degree)
    matrix = np.zeros((here.shape[1],) * 2)
    for band in range(degree + 1):
        rows = slice(band * band, (band + 1) * (band + 1))
        matrix[rows, rows] = np.linalg.lstsq(here[:, rows], before[:, rows], rcond=None)[0]
    return matrix


def _evenly_spread_directions(count: int) -> Float64:
    """Return a Fibonacci spiral of `count` unit vectors."""
    index = np.arange(count) + 0.5
    z = 1 - 2 * index / count
    angle = np.pi * (1 + 5**0.5) * index
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
