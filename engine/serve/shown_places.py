"""Where the photos show an object that was found in none of them: the background, or one made by hand.

Runs in a child process, because a scene takes more memory than the server may.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.files import path_within
from ..formats import read_ply
from ..project.content import scene_file
from ..project.objects import load_membership
from ..scene import Camera, photo_pixels, read_camera_set

_CELLS = 96  # by definition
"""Cells along the longest side of a photo in which the nearest Gaussian is looked for."""
_BEHIND = 1.1
"""Depth, relative to the nearest Gaussian of a cell, up to which a Gaussian is taken for seen."""  # by definition
_SOLID = 0.0
"""Logit of the opacity from which on a Gaussian hides others: an opacity of a half."""  # by definition
_OUTLIERS = (2.0, 98.0)  # by definition
"""Percentiles of the places of its Gaussians between which an object is shown."""


def best_place(project: str, object_id: str, threshold: float, photos: list[str]) -> tuple[str, list[float]] | None:
    """Return the photo that shows most of an object in the largest size, and where.

    Parameters
    ----------
    project : str
        The engine's project folder.
    threshold : float
        Smallest membership of a Gaussian of the object.
    photos : list of str
        Names of the photos to choose from.

    Returns
    -------
    (str, list of float) or None
        Name of the photo, and left, top, right and bottom edge in shares of its sides; None when no photo shows it.

    Raises
    ------
    HeritageError
        When a part of the project is damaged.
    """
    folder = Path(project)
    scene = read_ply(scene_file(folder))
    members = load_membership(folder, object_id, len(scene)) >= np.float32(threshold)
    shown = members | (scene.opacity_logits.reshape(-1) > _SOLID)
    means, members = scene.means[shown].astype(np.float64), members[shown]
    best: tuple[float, str, list[float]] | None = None
    for camera in read_camera_set(path_within(folder, "cameras")).cameras:
        seen = _seen(camera, means, members) if camera.photo in photos else None
        if seen is None or len(seen) == 0:
            continue
        low, high = np.clip(np.percentile(seen, _OUTLIERS, axis=0), 0.0, 1.0)
        side = float(max((high - low) * (camera.width, camera.height))) / max(camera.width, camera.height)
        value = len(seen) * side
        if best is None or value > best[0]:
            best = value, camera.photo, [*low.tolist(), *high.tolist()]
    return None if best is None else best[1:]


def _seen(camera: Camera, means: NDArray[np.float64], members: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return where a photo shows the members of `means` [N, 3] that nothing hides, [M, 2], in shares of its sides."""
    viewmat = np.asarray(camera.viewmat)
    local = means @ viewmat[:3, :3].T + viewmat[:3, 3]
    before = local[:, 2] > 0
    local, members = local[before], members[before]
    places = photo_pixels(camera, local[:, :2] / local[:, 2:]) / (camera.width, camera.height)
    inside = ((places >= 0) & (places < 1)).all(axis=1)  # NaN is outside
    places, depths, members = places[inside], local[inside, 2], members[inside]
    longest = max(camera.width, camera.height)
    cells = (places * (_CELLS * camera.width / longest, _CELLS * camera.height / longest)).astype(np.intp)
    number = cells[:, 1] * _CELLS + cells[:, 0]
    nearest = np.full(_CELLS * _CELLS, np.inf)
    np.minimum.at(nearest, number, depths)
    return places[members & (depths <= _BEHIND * nearest[number])]
