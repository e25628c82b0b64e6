"""Real spherical harmonics of 3D Gaussian splatting, and the rotation of their coefficients."""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float64

SH_C0 = 0.28209479177387814
"""Value of the constant basis function, 1 / (2 sqrt(pi)). Colour = 0.5 + SH_C0 * sh[:, 0] for degree 0."""
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
        Bands l in ascending order, with m = -l..l in each band, and the signs of Kerbl et al. 2023.
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
    """Return the matrix that transforms SH coefficients when their object is rotated or mirrored.

    Parameters
    ----------
    orthogonal : array of shape [3, 3], float64
        A rotation, or a rotation with a reflection.
    degree : int
        0 to 3.

    Returns
    -------
    array of shape [n, n], float64, n = (degree + 1)^2
        For each colour channel ``new = matrix @ old``, such that the new function has the value at ``orthogonal @ d``
        that the old function has at ``d``.

    Notes
    -----
    Each band is closed under orthogonal maps, so a least-squares fit to more directions than coefficients is exact. On
    evenly spread directions the basis is nearly orthogonal: for every rotation the condition number is below 1.5 and
    the error a few units of rounding, without the special cases of the recurrences of Ivanic and Ruedenberg 1996.
    """
    directions = _evenly_spread_directions(64)
    original = sh_basis(directions @ orthogonal, degree)
    transformed = sh_basis(directions, degree)
    matrix = np.zeros((transformed.shape[1],) * 2)
    for band in range(degree + 1):
        rows = slice(band * band, (band + 1) * (band + 1))
        matrix[rows, rows] = np.linalg.lstsq(transformed[:, rows], original[:, rows], rcond=None)[0]
    return matrix


def _evenly_spread_directions(count: int) -> Float64:
    """Return `count` unit vectors on a Fibonacci spiral."""
    index = np.arange(count) + 0.5
    z = 1 - 2 * index / count
    angle = np.pi * (1 + 5**0.5) * index
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
