"""Quality of trained Gaussians on photos at one size, which makes runs trained at different sizes comparable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import flip_evaluator
import numpy as np
import torch
from numpy.typing import NDArray

from ..core.arrays import evenly_spaced_indices
from ..core.events import StopCheck
from ..rasterizer.settings import Backend
from ..scene import CameraSet, Gaussians
from .checkpoint import read_checkpoint
from .coverage import WELL_SEEN, Coverage
from .held_out import MAX_MEASURED_PHOTOS, Quality, image_quality, mean_quality, render_picture
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
    return measure_levels(values, levels, coverage, backend=settings.backend, sh_degree=degree, with_flip=True)


def measure_levels(
    values: dict[str, torch.Tensor],
    levels: Sequence[Level],
    coverage: Coverage,
    *,
    backend: Backend,
    sh_degree: int,
    with_flip: bool = False,
) -> MeasuredQuality:
    """Return the mean quality over the photos in `levels`; `coverage` is that of the training photos."""
    whole, fitted, well_seen, flips = [], [], [], []
    n_pixels = n_well_seen = n_bright = n_dark = 0
    for level in levels:
        image = render_picture(values, level, backend=backend, sh_degree=sh_degree)
        whole.append(image_quality(image, level.pixels, level.valid))
        fitted.append(image_quality(image * brightness_factors(image, level), level.pixels, level.valid))
        if with_flip:
            flips.append(_flip(image.numpy(), level))
        valid = np.ones(level.pixels.shape[:2], bool) if level.valid is None else level.valid
        seen = valid & (coverage.counts(level.camera) >= WELL_SEEN)
        if seen.any():
            well_seen.append(image_quality(image, level.pixels, seen))
        brightness, expected = image.numpy().mean(axis=2), level.pixels.mean(axis=2) / 255.0
        bright = valid & (expected > BRIGHT)
        n_pixels, n_well_seen = n_pixels + int(valid.sum()), n_well_seen + int(seen.sum())
        n_bright, n_dark = n_bright + int(bright.sum()), n_dark + int((bright & (brightness < expected / 2)).sum())
    return MeasuredQuality(
        mean_quality(whole),
        mean_quality(fitted),
        mean_quality(well_seen) if well_seen else None,
        n_well_seen / max(n_pixels, 1),
        n_dark / max(n_bright, 1),
        float(np.mean(flips)) if flips else None,
    )


def _flip(image: NDArray[np.float32], level: Level) -> float:
    photo = level.pixels.astype(np.float32) / np.float32(255.0)
    errors, mean, _ = flip_evaluator.evaluate(photo, image, "LDR", applyMagma=False)
    return float(mean if level.valid is None else errors[level.valid].mean())


def gaussians_so_far(folder: Path) -> tuple[int, Gaussians] | None:
    """Return the finished steps and the Gaussians of the checkpoint in `folder`, None without a complete one."""
    state = read_checkpoint(folder)
    return None if state is None else (state.step, state.parameters.to_gaussians(unit_features=True))
