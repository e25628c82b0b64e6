"""A capture with a known scene: photos of 48 x 36 pixels, rendered from Gaussians by our rasterizer.

It is trained like any capture: its poses and sparse points, in a frame of their own, go through `cameras.normalise` and
`training.start`.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import ArrayLike

from ...cameras import normalised_points, normalised_viewmat, original_from_world
from ...core.arrays import Float64, Pixels
from ...core.events import ignore_events
from ...formats import SH_C0
from ...rasterizer import rasterize
from ...scene import CameraSet, Gaussians, PinholeCamera
from ...training import TrainingView, is_held_out, start_gaussians
from ...training.settings import PRESETS, TrainingSettings

WIDTH, HEIGHT = 48, 36
FOCAL = 44.0
N_PHOTOS = 12

_RATES = ("lr_means", "lr_means_end", "lr_scales", "lr_quats", "lr_opacity", "lr_sh", "lr_exposure")


def scale_learning_rates(settings: TrainingSettings, factor: float) -> TrainingSettings:
    """Return the settings with the learning rates that these captures use multiplied by `factor`."""
    return settings.changed(**{name: factor * getattr(settings.optimiser, name) for name in _RATES})


SETTINGS = scale_learning_rates(PRESETS["test"], 4.0)
SETTINGS = SETTINGS.changed(
    steps=120, max_gaussians=400, train_features=False, background_fraction=0.0, held_out_every=4,
    checkpoint_interval=30, curve_points=3, preview_seconds=3600.0,
)  # fmt: skip
"""The preset ``test`` with enough steps for the undisturbed capture, and without features."""


@dataclass(frozen=True)
class Capture:
    """Photos with poses and sparse points in a frame of their own.

    Attributes
    ----------
    photos : tuple of arrays of shape [h, w, 3], uint8
    viewmats : array of shape [P, 4, 4], float64
        World-to-camera matrices that training is given. They may be wrong.
    focal : float
        Focal length in pixels that training is given. It may be wrong.
    points : array of shape [M, 3], float64
    colors : array of shape [M, 3], uint8
    held_out : frozenset of int or None
        Indices of photos that are not trained on; None if training selects them.
    """

    photos: tuple[Pixels, ...]
    viewmats: Float64
    focal: float
    points: Float64
    colors: Pixels
    held_out: frozenset[int] | None = None

    def select_photos(self, numbers: Sequence[int], *, held_out: frozenset[int] | None = None) -> Capture:
        """Return the capture with these photos in this order. `held_out` are positions in the new order."""
        photos = tuple(self.photos[i] for i in numbers)
        return replace(self, photos=photos, viewmats=self.viewmats[list(numbers)], held_out=held_out)

    def split(self) -> tuple[list[int], list[int]]:
        """Return the indices of the training photos, and of the evaluated photos: held-out ones, or else the same."""
        n = range(len(self.photos))
        named = self.held_out
        held_out = [
            i for i in n if (is_held_out(i, SETTINGS.measurement.held_out_every) if named is None else i in named)
        ]
        training = [i for i in n if i not in held_out]
        return training, held_out or training

    def without_points(self) -> Capture:
        """Return the capture without sparse points."""
        return replace(self, points=self.points[:0], colors=self.colors[:0])

    def with_gains(self, gains: Sequence[float], *, points: float = 1.0) -> Capture:
        """Return the capture with photo i made `gains[i]` times as bright and the sparse points `points` times."""

        def brighter(pixels: Pixels, gain: float) -> Pixels:
            return (gain * pixels.astype(np.float64)).round().clip(0, 255).astype(np.uint8)

        photos = tuple(brighter(photo, gain) for photo, gain in zip(self.photos, gains, strict=True))
        return replace(self, photos=photos, colors=brighter(self.colors, points))

    def with_flat_photos(self, level: int) -> Capture:
        """Return the capture with photos of one gray level and, as nothing can be matched in them, without points."""
        return replace(self, photos=tuple(np.full_like(photo, level) for photo in self.photos)).without_points()

    def transformed(self, *, scale: float = 1.0, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> Capture:
        """Return the capture with its world multiplied by `scale`, then moved by `offset`."""
        viewmats = self.viewmats.copy()
        viewmats[:, :3, 3] *= scale
        viewmats[:, :3, 3] -= viewmats[:, :3, :3] @ np.asarray(offset)
        return replace(self, viewmats=viewmats, points=self.points * scale + np.asarray(offset))


@dataclass(frozen=True)
class TrainingInput:
    """Input of training for a capture.

    Attributes
    ----------
    start : Gaussians
    views : tuple of TrainingView
    """

    start: Gaussians
    views: tuple[TrainingView, ...]

    def with_start(self, **rows: tuple[Sequence[int] | slice, float]) -> TrainingInput:
        """Return the input with rows of the start arrays set to a value: ``means=([3], nan)``."""
        arrays = {name: getattr(self.start, name).copy() for name in rows}
        for name, (index, value) in rows.items():
            arrays[name][index] = value
        return replace(self, start=replace(self.start, **arrays))


def training_input(capture: Capture, settings: TrainingSettings) -> TrainingInput:
    """Return start and views of `capture`, as the pipeline makes them for given poses."""
    similarity = original_from_world(list(capture.viewmats), capture.points)
    training, _ = capture.split()
    views = [
        TrainingView(
            f"{i:02d}.png",
            pinhole(normalised_viewmat(viewmat, similarity), capture.focal),
            pixels,
            None,
            i not in training,
        )
        for i, (pixels, viewmat) in enumerate(zip(capture.photos, capture.viewmats, strict=True))
    ]
    points = normalised_points(capture.points, similarity)
    cameras = CameraSet((), (), points, capture.colors, float("nan"), similarity, True)
    return TrainingInput(start_gaussians(cameras, views, settings, emit=ignore_events), tuple(views))


def pinhole(viewmat: Float64, focal: float) -> PinholeCamera:
    """Return a camera of 48 x 36 pixels."""
    k = np.array([[focal, 0.0, WIDTH / 2], [0.0, focal, HEIGHT / 2], [0.0, 0.0, 1.0]])
    return PinholeCamera(viewmat, k, WIDTH, HEIGHT)


@functools.cache
def known_capture(*, ground: bool = True) -> tuple[Capture, Gaussians]:
    """Return a capture of 12 photos around two balls, with a floor or without, and the Gaussians of the scene.

    The sparse points are a third of the Gaussians' centres, displaced by a third of their size, with their colours.
    """
    truth = _two_balls(ground)
    angles = 2.0 * np.pi * np.arange(N_PHOTOS) / N_PHOTOS
    viewmats = np.stack([look_at_viewmat([2.5 * np.cos(angle), 2.5 * np.sin(angle), 1.0]) for angle in angles])
    photos = tuple(render_pixels(truth, pinhole(viewmat, FOCAL)) for viewmat in viewmats)
    rng = np.random.default_rng(3)
    chosen = np.sort(rng.choice(len(truth), len(truth) // 3, replace=False))
    points = truth.means[chosen] + rng.normal(0.0, 0.02, (len(chosen), 3))
    colors = (255.0 * (0.5 + SH_C0 * truth.sh[chosen, 0])).round().astype(np.uint8)
    return Capture(photos, viewmats, FOCAL, points, colors), truth


def render_pixels(gaussians: Gaussians, camera: PinholeCamera) -> Pixels:
    """Return the picture of `gaussians`, uint8 [h, w, 3]."""
    arrays = [gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities]
    means, quats, scales, opacities = (torch.from_numpy(array) for array in arrays)
    image = rasterize(means, quats, scales, opacities, camera=camera, sh=torch.from_numpy(gaussians.sh)).image
    pixels: Pixels = (255.0 * image.clamp(0.0, 1.0)).round().to(torch.uint8).numpy()
    return pixels


def _two_balls(ground: bool) -> Gaussians:
    rng = np.random.default_rng(7)

    def ball(center: list[float], n: int) -> Float64:
        direction = rng.normal(size=(n, 3))
        return np.array(center) + 0.3 * direction / np.linalg.norm(direction, axis=1, keepdims=True)

    floor = np.column_stack([rng.uniform(-1.2, 1.2, (160, 2)), np.full(160, -0.32)])
    means = np.concatenate([floor, ball([-0.5, 0.0, 0.0], 80), ball([0.5, 0.0, 0.0], 80)])
    part = np.repeat([0, 1, 2], [160, 80, 80])
    colors = np.array([[0.6, 0.6, 0.5], [0.8, 0.15, 0.1], [0.1, 0.2, 0.8]])[part] + rng.normal(0.0, 0.1, (320, 3))
    truth = Gaussians(
        means=means.astype(np.float32),
        log_scales=np.log(np.where(part == 0, 0.11, 0.07))[:, None].repeat(3, axis=1).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (320, 1)),
        opacity_logits=np.full(320, 2.0, np.float32),
        sh=((colors.clip(0.02, 0.98) - 0.5) / SH_C0).astype(np.float32)[:, None],
    )
    return truth if ground else truth[part > 0]


def look_at_viewmat(center: ArrayLike, target: ArrayLike = (0.0, 0.0, 0.0)) -> Float64:
    """Return the world-to-camera matrix [4, 4] of a camera at `center` that looks at `target`; Z is up."""
    position = np.asarray(center, np.float64)
    forward = np.asarray(target, np.float64) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    viewmat[:3, 3] = -viewmat[:3, :3] @ position
    return viewmat
