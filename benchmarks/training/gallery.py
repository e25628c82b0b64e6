"""A walk through four rooms of the building of `benchmarks.scale`, papered walls and cases: nothing is chosen on it.

Cameras are the true ones. The sparse points are places on surfaces that random pixels show, so that no program that
finds cameras has a part in what training reaches.
"""

from __future__ import annotations

import numpy as np

from engine.scene import CameraSet, PinholeCamera
from engine.training import TrainingView, is_held_out

from ..scale.building import FOCAL, HEIGHT, PHOTOS_PER_ROOM, WIDTH, Building

_SEED, _N_ROOMS = 0, 4
_POINTS_PER_PHOTO = 150


def gallery_views(held_out_every: int) -> tuple[CameraSet, list[TrainingView]]:
    """Return the sparse points, in a `CameraSet` without cameras, and the views, of which some are test photos."""
    building, rng = Building(_SEED), np.random.default_rng(_SEED)
    K = np.array([[FOCAL, 0.0, WIDTH / 2], [0.0, FOCAL, HEIGHT / 2], [0.0, 0.0, 1.0]])
    viewmats = building.cameras(PHOTOS_PER_ROOM * _N_ROOMS)
    views, points, colors = [], [], []
    for number, viewmat in enumerate(viewmats):
        picture, depth = building.seen(viewmat.astype(np.float32))
        held_out = is_held_out(number, held_out_every)
        views.append(
            TrainingView(f"{number:04d}.png", PinholeCamera(viewmat, K, WIDTH, HEIGHT), picture, None, held_out)
        )
        if not held_out:
            x, y = rng.integers(WIDTH, size=_POINTS_PER_PHOTO), rng.integers(HEIGHT, size=_POINTS_PER_PHOTO)
            rays = np.stack([x + 0.5, y + 0.5, np.ones(_POINTS_PER_PHOTO)], axis=1) @ np.linalg.inv(K).T
            points.append((rays * depth[y, x, None] - viewmat[:3, 3]) @ viewmat[:3, :3])
            colors.append(picture[y, x])
    found = np.concatenate(points).astype(np.float32)
    return CameraSet((), (), found, np.concatenate(colors), float("nan"), np.eye(4), True), views
