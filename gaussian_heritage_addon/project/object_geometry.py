"""Where an object is: the foot that it stands on, and the Gaussians around it. Does not import bpy.

Arrays are in the frame of the scene, Z up, in its units.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...engine.formats import transform_gaussians
from ...engine.scene import Gaussians, box_of


def near_object(means: NDArray[np.float32], is_member: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which Gaussians may belong to an object when its threshold is lowered, shape [N].

    These are its members, and all that lie within the box of the members, extended by its own size to every side.

    Parameters
    ----------
    means : array of shape [N, 3]
    is_member : array of shape [N]
        Whether each Gaussian belongs to the object at its threshold.
    """
    if not is_member.any():
        return np.ones(len(means), bool)
    low, high = box_of(means[is_member])
    size = high - low
    inside = ((means >= low - size) & (means <= high + size)).all(axis=1)
    return inside | is_member


def moved_gaussians(gaussians: Gaussians, matrix: NDArray[np.floating]) -> Gaussians:
    """Return the Gaussians moved by an affine map [4, 4]. Where it only shifts, the rest stays bit by bit."""
    if not (matrix[:3, :3] == np.eye(3)).all():
        return transform_gaussians(gaussians, matrix.astype(np.float64))
    return replace(gaussians, means=(gaussians.means + matrix[:3, 3]).astype(np.float32))
