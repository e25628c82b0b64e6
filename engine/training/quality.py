"""How good trained Gaussians are on photos at one size, so that runs trained at different sizes compare."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import flip_evaluator
import numpy as np
from numpy.typing import NDArray

from ..events import StopCheck
from ..scene import CameraSet, Gaussians
from .checkpoint import read_state
from .held_out import Quality, image_quality, mean_quality, render_picture
from .parameters import Parameters
from .settings import TrainingSettings
from .views import Level, ViewPyramid, load_views

__all__ = ["Judgement", "gaussians_so_far", "judge"]

_MOST_PHOTOS = 8


@dataclass(frozen=True)
class Judgement:
    """How good Gaussians are: `Quality`, and FLIP.

    Attributes
    ----------
    quality : Quality
    flip : float
        Mean difference that a person sees switching between picture and photo, 0 to 1, at 67 pixels a degree
        (Andersson et al. 2020, by their own package). Too dear for the curve: 0.6 CPU s a photo of 640x480.
    """

    quality: Quality
    flip: float


def judge(
    gaussians: Gaussians,
    photo_folder: Path,
    camera_set: CameraSet,
    names: Sequence[str],
    *,
    max_side: int,
    photo_masks: Mapping[str, Path] | None = None,
    should_stop: StopCheck,
) -> Judgement:
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
    photo_masks : mapping of str to Path, optional
        Which pixels of a photo count, by photo name.
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
    chosen = replace(camera_set, cameras=cameras)
    views = load_views(photo_folder, chosen, {}, settings, photo_masks=photo_masks, should_stop=should_stop)
    pyramid = ViewPyramid(views, settings)
    values = Parameters.from_gaussians(gaussians, sh_degree=degree, features=False).values
    found, flips = [], []
    for level in (pyramid.level(i, 0) for i in range(len(views))):
        image = render_picture(values, level, settings, sh_degree=degree)
        found.append(image_quality(image, level.pixels, level.valid))
        flips.append(_flip(image.numpy(), level))
    return Judgement(mean_quality(found), float(np.mean(flips)))


def _flip(image: NDArray[np.float32], level: Level) -> float:
    photo = level.pixels.astype(np.float32) / np.float32(255.0)
    errors, mean, _ = flip_evaluator.evaluate(photo, image, "LDR", applyMagma=False)
    return float(mean if level.valid is None else errors[level.valid].mean())


def gaussians_so_far(folder: Path) -> Gaussians | None:
    """Return the Gaussians of the checkpoint in `folder`, None when there is no whole one."""
    state = read_state(folder)
    return None if state is None else state.parameters.to_gaussians(unit_features=False)
