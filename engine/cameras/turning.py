"""Cameras of pictures that a program saw turned or mirrored, as cameras of the upright photos.

Programs that ignore the EXIF orientation of a photo place the picture as it is stored. An orientation is the number
that EXIF gives to what makes the stored picture upright: 1 leaves it, 3 turns it by 180 degrees, 6 by 90 degrees
clockwise, 8 by 90 degrees anticlockwise; 2, 4, 5 and 7 mirror it, too.

Conventions: camera axes are x right, y down, z forward; pixels begin at the corner of the picture.
"""

from __future__ import annotations

import numpy as np

from ..core.arrays import Float64
from ..scene import Lens, focal_and_center
from .undistortion import require_valid_lens

ORIENTATIONS = range(1, 9)
MIRRORED = frozenset({2, 4, 5, 7})
MIRROR: Float64 = np.diag([-1.0, 1.0, 1.0])
"""Turns the mirrored world of mirrored pictures into the true one."""
_SIDEWAYS = 5
"""The smallest orientation that exchanges width and height."""
_TURNS: dict[int, Float64] = {
    1: np.array([[1.0, 0.0], [0.0, 1.0]]),
    2: np.array([[-1.0, 0.0], [0.0, 1.0]]),
    3: np.array([[-1.0, 0.0], [0.0, -1.0]]),
    4: np.array([[1.0, 0.0], [0.0, -1.0]]),
    5: np.array([[0.0, 1.0], [1.0, 0.0]]),
    6: np.array([[0.0, -1.0], [1.0, 0.0]]),
    7: np.array([[0.0, -1.0], [-1.0, 0.0]]),
    8: np.array([[0.0, 1.0], [-1.0, 0.0]]),
}
"""Directions in the upright picture from directions in the stored one, by orientation."""

_VECTORS: dict[str, tuple[tuple[int, int], ...]] = {
    "OPENCV": ((7, 6),),
    "FULL_OPENCV": ((7, 6),),
    "THIN_PRISM_FISHEYE": ((7, 6), (10, 11)),
    "RAD_TAN_THIN_PRISM_FISHEYE": ((10, 11), (12, 14), (13, 15)),
}
"""Indices of the parameters that are the x and y of a vector in the picture, by lens model: tangential distortion,
whose x is the second coefficient of OpenCV's, and thin prisms. All other parameters after the centre are radial."""


def turned_size(width: int, height: int, orientation: int) -> tuple[int, int]:
    """Return the size of the upright picture."""
    return (height, width) if orientation >= _SIDEWAYS else (width, height)


def turned_pixels(pixels: Float64, width: int, height: int, orientation: int) -> Float64:
    """Return where pixels [N, 2] of a stored picture of `width` x `height` are in the upright one."""
    turn = _TURNS[orientation]
    # A negative entry counts from the other end of its axis of the stored picture.
    start = np.minimum(turn, 0.0) @ np.array([width, height], np.float64)
    turned: Float64 = pixels @ turn.T - start
    return turned


def turned_lens(lens: Lens, orientation: int) -> Lens:
    """Return the lens of the upright picture for that of the stored one."""
    turn = _TURNS[orientation]
    width, height = turned_size(lens.width, lens.height, orientation)
    fx, fy, cx, cy = focal_and_center(lens)
    center = turned_pixels(np.array([[cx, cy]]), lens.width, lens.height, orientation)[0]
    params = list(lens.params)
    if len(require_valid_lens(lens).focal_length_idxs()) == 1:
        params[1:3] = center
    else:
        params[:4] = (fy, fx, *center) if orientation >= _SIDEWAYS else (fx, fy, *center)
    for x, y in _VECTORS.get(lens.model, ()):
        params[x], params[y] = turn @ (params[x], params[y])
    return Lens(lens.model, width, height, tuple(float(value) for value in params))


def turned_viewmat(viewmat: Float64, orientation: int) -> Float64:
    """Return the world-to-camera matrix [4, 4] of the upright picture; for a mirrored one, in the mirrored world."""
    turn = np.eye(4)
    turn[:2, :2] = _TURNS[orientation]
    turned: Float64 = turn @ viewmat
    if orientation in MIRRORED:
        turned[:3, :3] = turned[:3, :3] @ MIRROR
    return turned
