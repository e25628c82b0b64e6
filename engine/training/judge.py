"""How good trained Gaussians are on photos at one size, so that runs trained at different sizes compare."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..cameras.camera import CameraSet
from ..events import StopCheck
from ..gaussians.gaussians import Gaussians
from .checkpoint import read_state
from .held_out import Quality, measure
from .parameters import Parameters
from .settings import TrainingSettings
from .views import ViewPyramid, load_views

__all__ = ["gaussians_so_far", "judge"]

_MOST_PHOTOS = 8


def judge(
    gaussians: Gaussians,
    photo_folder: Path,
    camera_set: CameraSet,
    names: Sequence[str],
    *,
    max_side: int,
    should_stop: StopCheck,
) -> Quality:
    """Return the mean quality on photos.

    Parameters
    ----------
    gaussians : Gaussians
    photo_folder : Path
    camera_set : CameraSet
    names : sequence of str
        Photos to measure on; of more than 8, 8 that are evenly spread, as training takes.
    max_side : int
        Longest side of the pictures, pixels.
    should_stop : StopCheck

    Raises
    ------
    PhotoError
        When a photo went away.
    Cancelled
        When `should_stop` says so.
    """
    picked = [names[i] for i in np.linspace(0, len(names) - 1, min(_MOST_PHOTOS, len(names))).round().astype(int)]
    cameras = tuple(camera for camera in camera_set.cameras if camera.photo in picked)
    degree = int(round(gaussians.sh.shape[1] ** 0.5)) - 1
    settings = TrainingSettings(max_side=max_side, sh_degree=degree, features=False, held_out_every=0)
    views = load_views(photo_folder, replace(camera_set, cameras=cameras), {}, settings, should_stop=should_stop)
    pyramid = ViewPyramid(views, settings)
    values = Parameters.from_gaussians(gaussians, sh_degree=degree, features=False).values
    return measure(values, [pyramid.level(i, 0) for i in range(len(views))], settings, sh_degree=degree)


def gaussians_so_far(folder: Path) -> Gaussians | None:
    """Return the Gaussians of the checkpoint in `folder`, None when there is no whole one."""
    state = read_state(folder)
    return None if state is None else state.parameters.to_gaussians(unit_features=False)
