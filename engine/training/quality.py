"""Quality of trained Gaussians on photos at one size, which makes runs trained at different sizes comparable."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import flip_evaluator
import numpy as np
import torch
from numpy.typing import NDArray

from ..core.arrays import evenly_spaced_indices
from ..core.events import StopCheck
from ..scene import CameraSet, Gaussians
from .checkpoint import read_checkpoint
from .coverage import WELL_SEEN, Coverage
from .held_out import MAX_MEASURED_PHOTOS, Quality, image_quality, in_threads, mean_quality, render_picture
from .parameters import Parameters
from .settings import TrainingSettings
from .trials import brightness_factors
from .views import Level, ViewPyramid, load_views

BRIGHT = 40.0 / 255.0
"""Brightness of a photo's pixel from which a picture of less than half of it counts as dark."""


@dataclass(frozen=True)
class MeasuredQuality:
    """Quality of Gaussians on photos; all but the shares are means over the photos.

    Attributes
    ----------
    quality : Quality
    fitted : Quality
        With the brightness of each picture fitted to its photo: the exposure of a photo that was not trained on is
        unknown.
    well_seen : Quality or None
        In the pixels that show what at least three training photos see, see `coverage.Coverage`; None without any.
    well_seen_share : float
        Share of these pixels.
    dark_share : float
        Share of the photos' pixels brighter than 40 of 255 that are rendered less than half as bright.
    flip : float or None
        Mean visible difference when switching between picture and photo, 0 to 1, at 67 pixels per degree (Andersson et
        al. 2020, computed by their package); None where it was not measured, since it takes 0.6 CPU s per photo.
    """

    quality: Quality
    fitted: Quality
    well_seen: Quality | None
    well_seen_share: float
    dark_share: float
    flip: float | None = None


def measure_quality(
    gaussians: Gaussians,
    photo_folder: Path,
    camera_set: CameraSet,
    names: Sequence[str],
    *,
    trained: Sequence[str],
    max_side: int,
    photo_masks: Mapping[str, Path] | None = None,
    should_stop: StopCheck,
) -> MeasuredQuality:
    """Return the mean quality on photos.

    Parameters
    ----------
    names : sequence of str
        Photos to measure on; of more than 8 photos, 8 evenly spaced ones.
    trained : sequence of str
        The training photos.
    max_side : int
        Longest side of the pictures, pixels.
    photo_masks : mapping of str to Path, optional
        Files of the masks of valid pixels by photo name.

    Raises
    ------
    PhotoError
        When a photo is missing.
    Cancelled
        When `should_stop` returns true.
    """
    from ..cameras import training_pinhole

    chosen = [names[index] for index in evenly_spaced_indices(len(names), MAX_MEASURED_PHOTOS)]
    cameras = tuple(camera for camera in camera_set.cameras if camera.photo in chosen)
    degree = int(round(gaussians.sh.shape[1] ** 0.5)) - 1
    settings = TrainingSettings().changed(max_side=max_side, train_features=False, held_out_every=0)
    subset = replace(camera_set, cameras=cameras)
    views = load_views(photo_folder, subset, {}, settings, photo_masks=photo_masks, should_stop=should_stop)
    pyramid = ViewPyramid(views, settings.features)
    values = Parameters.from_gaussians(gaussians, sh_degree=degree, features=False).values
    seeing = [training_pinhole(camera, max_side=max_side) for camera in camera_set.cameras if camera.photo in trained]
    coverage = Coverage(values, seeing, backend=settings.backend)
    levels = [pyramid.level(i, 0) for i in range(len(views))]
    picture = functools.partial(render_picture, values, backend=settings.backend, sh_degree=degree)
    return measure_levels(picture, levels, coverage, with_flip=True)


def measure_levels(
    picture: Callable[[Level], torch.Tensor], levels: Sequence[Level], coverage: Coverage, *, with_flip: bool = False
) -> MeasuredQuality:
    """Return the mean quality over the photos in `levels`; `coverage` is that of the training photos.

    `picture` renders one as `held_out.render_picture` does. One is rendered after the other; others are measured at the
    same time, in threads.
    """
    each = in_threads(
        functools.partial(_measured, picture(level), level, coverage.counting(level.camera), with_flip)
        for level in levels
    )
    well_seen = [one.well_seen for one in each if one.well_seen is not None]
    n_pixels, n_well_seen, n_bright, n_dark = np.sum([one.counts for one in each], axis=0).tolist()
    return MeasuredQuality(
        mean_quality([one.whole for one in each]),
        mean_quality([one.fitted for one in each]),
        mean_quality(well_seen) if well_seen else None,
        n_well_seen / max(n_pixels, 1),
        n_dark / max(n_bright, 1),
        float(np.mean([one.flip for one in each])) if with_flip else None,
    )


class _OfPicture(NamedTuple):
    """Quality of a picture, as in `MeasuredQuality`; number of valid, well seen, bright, and bright but dark pixels."""

    whole: Quality
    fitted: Quality
    well_seen: Quality | None
    counts: tuple[int, int, int, int]
    flip: float


def _measured(image: torch.Tensor, level: Level, count: Callable[[], NDArray[np.int32]], with_flip: bool) -> _OfPicture:
    valid = np.ones(level.pixels.shape[:2], bool) if level.valid is None else level.valid
    seen = valid & (count() >= WELL_SEEN)
    brightness, expected = image.numpy().mean(axis=2), level.pixels.mean(axis=2) / 255.0
    bright = valid & (expected > BRIGHT)
    dark = bright & (brightness < expected / 2)
    return _OfPicture(
        image_quality(image, level.pixels, level.valid),
        image_quality(image * brightness_factors(image, level), level.pixels, level.valid),
        image_quality(image, level.pixels, seen) if seen.any() else None,
        (int(valid.sum()), int(seen.sum()), int(bright.sum()), int(dark.sum())),
        _flip(image.numpy(), level) if with_flip else math.nan,
    )


def _flip(image: NDArray[np.float32], level: Level) -> float:
    photo = level.pixels.astype(np.float32) / np.float32(255.0)
    errors, mean, _ = flip_evaluator.evaluate(photo, image, "LDR", applyMagma=False)
    return float(mean if level.valid is None else errors[level.valid].mean())


def gaussians_so_far(folder: Path) -> tuple[int, Gaussians] | None:
    """Return the finished steps and the Gaussians of the checkpoint in `folder`, None without a complete one."""
    state = read_checkpoint(folder)
    return None if state is None else (state.step, state.parameters.to_gaussians(unit_features=True))
