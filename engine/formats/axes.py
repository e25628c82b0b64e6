"""The axes of files: rotations [4, 4] from the engine's world, in which Z is up, to that of a file."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Up = Literal["z", "-y", "y"]
"""Axis of a file that points up."""


def y_up_from_z_up() -> NDArray[np.float64]:
    """Return the rotation to glTF's world (Y up): (x, y, z) becomes (x, z, -y)."""
    return np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)


def z_up_from_y_up() -> NDArray[np.float64]:
    """Return the rotation from glTF's world to the engine's, the inverse of `y_up_from_z_up`."""
    return y_up_from_z_up().T


def y_down_from_z_up() -> NDArray[np.float64]:
    """Return the rotation to the usual world of a 3DGS PLY (x right, y down, z forward): to (x, -z, y)."""
    return y_up_from_z_up().T


def file_from_z_up(up: Up | None) -> NDArray[np.float64]:
    """Return the rotation from the engine's world to that of a file with the axis `up`; None: the identity."""
    rotations = {"y": y_up_from_z_up, "-y": y_down_from_z_up}
    return rotations[up]() if up in rotations else np.eye(4)
