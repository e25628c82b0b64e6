"""The point that the cameras of a scene look at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def looked_at(viewmats: NDArray[np.float64]) -> tuple[list[float], float]:
    """Return the point nearest to all optical axes, and the median distance of the cameras from it.

    Parameters
    ----------
    viewmats : array of shape [n, 4, 4], float64
        World-to-camera, at least one.
    """
    rotations, translations = viewmats[:, :3, :3], viewmats[:, :3, 3]
    positions = -np.einsum("nij,ni->nj", rotations, translations)
    forward = rotations[:, 2]
    across = np.eye(3) - forward[:, :, None] * forward[:, None, :]
    # With parallel axes the sum is singular; lstsq then takes the point nearest to the origin.
    center = np.linalg.lstsq(across.sum(0), np.einsum("nij,nj->i", across, positions), rcond=1e-6)[0]
    return center.tolist(), float(np.median(np.linalg.norm(positions - center, axis=1)))
