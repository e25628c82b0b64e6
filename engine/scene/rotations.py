"""Rotations: matrices, and quaternions of Gaussians, wxyz, which map own axes to world axes. NumPy only."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core.arrays import Float64

_Float = TypeVar("_Float", np.float32, np.float64)


def is_rotation(matrix: NDArray[np.float64], *, tolerance: float = 1e-3) -> bool:
    """Return whether the finite `matrix` [3, 3] is a rotation.

    `tolerance` is that of the products of its rows: some programs write 6 digits, people who edit files fewer.
    """
    is_orthogonal = np.abs(matrix @ matrix.T - np.eye(3)).max() <= tolerance
    return bool(is_orthogonal and np.linalg.det(matrix) > 0.0)


def unit_quats(quats: NDArray[_Float]) -> NDArray[_Float]:
    """Return quaternions [N, 4] at unit length, in the precision given; a zero quaternion becomes the identity."""
    lengths = np.linalg.norm(quats, axis=1, keepdims=True)
    return np.where(lengths > 0, quats / np.where(lengths > 0, lengths, 1), (1.0, 0.0, 0.0, 0.0)).astype(quats.dtype)


def rotations_from_quats(quats: NDArray[np.floating]) -> Float64:
    """Return rotation matrices [N, 3, 3], float64, of wxyz quaternions [N, 4]; a zero quaternion gives the identity."""
    w, x, y, z = unit_quats(quats.astype(np.float64)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
