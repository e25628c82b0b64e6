"""Scenes before a plain sky are reconstructed without floaters in front of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from engine.cameras.normalise import normalised_points, normalised_viewmat, original_from_world
from engine.core.events import ignore_events, never_stop
from engine.formats.spherical_harmonics import SH_C0
from engine.quality.stability.training_scenes import known_capture, look_at_viewmat
from engine.rasterizer.api import rasterize
from engine.scene.camera import CameraSet, PinholeCamera
from engine.scene.gaussians import Gaussians
from engine.training.background import background_gaussians
from engine.training.loop import train
from engine.training.settings import PRESETS
from engine.training.start import start_gaussians
from engine.training.views import TrainingView

SETTINGS = PRESETS["preview"].changed(
    train_features=False, max_side=128, steps=300, max_gaussians=2000, held_out_every=6,
    preview_seconds=3600.0,
)  # fmt: skip
WIDTH, HEIGHT, FOCAL = 128, 96, 117.0


def camera_at(angle: float, height: float, distance: float) -> np.ndarray:
    return look_at_viewmat([distance * np.cos(angle), distance * np.sin(angle), height], [0.0, 0.0, 0.35])


def pinhole(viewmat: np.ndarray) -> PinholeCamera:
    return PinholeCamera(viewmat, np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]]), WIDTH, HEIGHT)


def under_the_sky(truth: Gaussians, viewmat: np.ndarray) -> np.ndarray:
    """A photo before a sky that is paler near the horizon."""
    camera = pinhole(viewmat)
    arrays = (truth.means, truth.quats, truth.scales, truth.opacities)
    raster = rasterize(*(torch.from_numpy(a) for a in arrays), camera=camera, sh=torch.from_numpy(truth.sh))
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2)
    rays = np.stack([x / FOCAL, y / FOCAL, np.ones_like(x)], axis=-1)
    up = (rays / np.linalg.norm(rays, axis=2, keepdims=True) @ viewmat[:3, :3])[..., 2]
    pale = np.exp(-4 * np.abs(up))
    sky = np.stack([0.45 + 0.3 * pale, 0.6 + 0.2 * pale, np.full_like(up, 0.9)], axis=-1)
    image = raster.image.numpy() + raster.transmittance.numpy()[..., None] * sky
    return (255 * image.clip(0, 1)).round().astype(np.uint8)


@pytest.mark.slow
def test_a_scene_under_a_plain_sky_has_no_floaters(tmp_path: Path) -> None:
    _, truth = known_capture()
    viewmats = [camera_at(2 * np.pi * i / 24, 0.4 if i % 2 else 1.0, 2.5) for i in range(24)]
    rng = np.random.default_rng(3)
    chosen = rng.integers(len(truth), size=900)
    points = truth.means[chosen] + rng.normal(0, 0.03, (900, 3))
    colors = (255 * (0.5 + SH_C0 * truth.sh[chosen, 0])).round().clip(0, 255).astype(np.uint8)
    similarity = original_from_world(viewmats, points)
    views = tuple(
        TrainingView(
            f"{i:02d}.png", pinhole(normalised_viewmat(v, similarity)), under_the_sky(truth, v), None, i % 6 == 3
        )
        for i, v in enumerate(viewmats)
    )
    cameras = CameraSet((), (), normalised_points(points, similarity), colors, float("nan"), similarity, True)
    start = start_gaussians(cameras, views, SETTINGS, emit=ignore_events)
    result = train(
        start, views, SETTINGS, checkpoints=tmp_path, emit=ignore_events, should_stop=never_stop,
        background=background_gaussians(cameras.points, views, SETTINGS),
    )  # fmt: skip
    assert result.curve[-1].psnr > 27

    scene = normalised_points(truth.means.astype(np.float64), similarity)
    unit = np.linalg.norm(scene[1] - scene[0]) / np.linalg.norm(truth.means[1] - truth.means[0])
    away = cKDTree(scene).query(result.gaussians.means)[0] / unit > 0.4
    inside = np.linalg.norm(result.gaussians.means - scene.mean(axis=0), axis=1) / unit < 3.5
    floaters = result.gaussians[away & inside]
    arrays = (floaters.means, floaters.quats, floaters.scales, floaters.opacities)
    for angle in range(6):
        # Nearer than any photo: what hangs between the cameras and the scene would fill the view.
        camera = pinhole(normalised_viewmat(camera_at(angle + 0.13, 0.7, 1.6), similarity))
        raster = rasterize(*(torch.from_numpy(a) for a in arrays), camera=camera, channels=torch.ones(len(floaters), 1))
        assert float((1 - raster.transmittance).mean()) < 0.1
