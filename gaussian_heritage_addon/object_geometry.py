"""Where an object is: the foot that it stands on, and the Gaussians around it. Does not import bpy.

Arrays are in the frame of the scene, Z up, in its units.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["box_of", "foot_of", "near_object"]

_TAILS = (0.01, 0.99)
"""Quantiles of the positions that count as the ends of an object: single Gaussians far away have no weight."""


def box_of(members: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower and the upper bounds of an object, each of shape [3], without single Gaussians far away.

    Parameters
    ----------
    members : array of shape [N, 3]
        Positions of the Gaussians of the object, at least one.
    """
    low, high = np.quantile(members, _TAILS, axis=0)
    return low, high


def foot_of(members: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the middle of the bottom of an object, shape [3].

    Parameters
    ----------
    members : array of shape [N, 3]
        Positions of the Gaussians of the object, at least one.
    """
    low, high = box_of(members)
    return np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])


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
