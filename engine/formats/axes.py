"""The axes of files: rotations [4, 4] from the engine's world, in which Z is up, to that of a file."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Up = Literal["z", "-y", "y"]
"""Axis of a file that points up."""


_ROTATIONS = {
    "z": np.eye(4),
    "y": np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=np.float64),
    "-y": np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=np.float64),
}


def file_from_z_up(up: Up | None) -> NDArray[np.float64]:
    """Return the rotation from the engine's world to that of a file with the axis `up`; None: the identity.

    In glTF's world, Y up, (x, y, z) becomes (x, z, -y); in the usual one of a 3DGS PLY (x right, y down, z forward),
    (x, -z, y).
    """
    return _ROTATIONS[up or "z"].copy()
