# SPDX-License-Identifier: GPL-3.0-or-later
"""True cameras as a COLMAP text model without points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from studio.phone import Phone
from studio.views import View


def model_files(views: Sequence[View], phone: Phone) -> dict[str, str]:
    """Return names and texts of the files of a COLMAP model with one SIMPLE_RADIAL camera."""
    cx, cy = phone.centre
    lens = f"1 SIMPLE_RADIAL {phone.width} {phone.height} {phone.focal!r} {cx!r} {cy!r} {phone.k1!r}"
    images = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; then an empty line for the points"]
    for number, view in enumerate(views, start=1):
        pose = [*quaternion(view.world_to_camera[:3, :3]), *view.world_to_camera[:3, 3]]
        images += [" ".join([str(number), *(f"{value:.12g}" for value in pose), "1", f"{view.name}.jpg"]), ""]
    return {
        "cameras.txt": f"# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n{lens}\n",
        "images.txt": "\n".join(images) + "\n",
        "points3D.txt": "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]; none\n",
    }


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix [3, 3]."""
    # The eigenvector of the largest eigenvalue, which is stable for all angles (Bar-Itzhack 2000).
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    symmetric = np.array(
        [
            [xx + yy + zz, zy - yz, xz - zx, yx - xy],
            [zy - yz, xx - yy - zz, yx + xy, zx + xz],
            [xz - zx, yx + xy, yy - xx - zz, zy + yz],
            [yx - xy, zx + xz, zy + yz, zz - xx - yy],
        ]
    )
    found = np.linalg.eigh(symmetric)[1][:, -1]
    return found if found[0] >= 0 else -found
