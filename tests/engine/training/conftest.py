"""A tiny scene with known ground truth: a red and a blue ball on a speckled floor, rendered as 64x48 photos."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch

from engine.core.events import ignore_events, never_stop
from engine.core.label_runs import LabelRuns
from engine.rasterizer.api import rasterize
from engine.scene.camera import PinholeCamera
from engine.scene.gaussians import Gaussians
from engine.training.initialise import InitialValues, gaussians_from_points
from engine.training.loop import train
from engine.training.result import TrainingResult
from engine.training.settings import PRESETS
from engine.training.views import TrainingView, is_held_out

WIDTH, HEIGHT, N_VIEWS = 64, 48, 12
N_MANY_VIEWS = 32
"""Four test photos, and 28 training photos of which three are validation photos."""


BANDS = PRESETS["test"].changed(
    steps=300, sh_degree=2, sh_interval=120, trial_fraction=0.2, min_trial_gain=0.1, train_features=False,
    coarse_levels=0, lr_sh_rest=0.003,
)  # fmt: skip
"""A training with two trials of bands of spherical harmonics."""


@dataclass(frozen=True)
class Scene:
    truth: Gaussians
    part: np.ndarray
    """0 floor, 1 red ball, 2 blue ball; per Gaussian of `truth`."""
    views: list[TrainingView]
    start: Gaussians


def camera_at(angle: float, *, width: int = WIDTH, height: int = HEIGHT) -> PinholeCamera:
    """A camera 2.5 away and 1 up that looks at the origin; Z is up."""
    center = np.array([2.5 * np.cos(angle), 2.5 * np.sin(angle), 1.0])
    forward = -center / np.linalg.norm(center)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    viewmat[:3, 3] = -viewmat[:3, :3] @ center
    focal = 0.9 * width
    return PinholeCamera(viewmat, np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]), width, height)


def make_truth() -> tuple[Gaussians, np.ndarray]:
    rng = np.random.default_rng(7)

    def ball(center: list[float], n: int) -> np.ndarray:
        direction = rng.normal(size=(n, 3))
        return np.array(center) + 0.3 * direction / np.linalg.norm(direction, axis=1, keepdims=True)

    floor = np.column_stack([rng.uniform(-1.2, 1.2, (400, 2)), np.full(400, -0.32)])
    means = np.concatenate([floor, ball([-0.5, 0, 0], 150), ball([0.5, 0, 0], 150)])
    part = np.repeat([0, 1, 2], [400, 150, 150])
    colors = np.array([[0.6, 0.6, 0.5], [0.8, 0.15, 0.1], [0.1, 0.2, 0.8]])[part]
    colors = np.clip(colors + rng.normal(0, 0.1, colors.shape), 0.02, 0.98)
    truth = Gaussians(
        means=means.astype(np.float32),
        log_scales=np.full((len(means), 3), np.log(0.07), np.float32),
        quats=np.tile(np.float32([1, 0, 0, 0]), (len(means), 1)),
        opacity_logits=np.full(len(means), 2.0, np.float32),
        sh=((colors - 0.5) / 0.28209479).astype(np.float32)[:, None],
    )
    return truth, part


def render_numpy(gaussians: Gaussians, camera: PinholeCamera, channels: np.ndarray | None = None) -> np.ndarray:
    """The picture [h, w, 3] of `gaussians`, or of `channels` [N, C] blended with them."""
    to = torch.from_numpy
    raster = rasterize(
        to(gaussians.means),
        to(gaussians.quats),
        to(gaussians.scales),
        to(gaussians.opacities),
        camera=camera,
        sh=to(gaussians.sh) if channels is None else None,
        channels=None if channels is None else to(channels.astype(np.float32)),
    )
    return raster.image.numpy()


def photograph(truth: Gaussians, part: np.ndarray, camera: PinholeCamera) -> tuple[np.ndarray, np.ndarray]:
    """The photo and its segments: the part that covers each pixel most, 0 where nothing covers by half."""
    pixels = (render_numpy(truth, camera).clip(0, 1) * 255).round().astype(np.uint8)
    cover = render_numpy(truth, camera, np.eye(3)[part])
    labels = np.where(cover.sum(axis=2) > 0.5, cover.argmax(axis=2) + 1, 0)
    return pixels, labels.astype(np.int32)


@pytest.fixture(scope="session")
def scene() -> Scene:
    return make_scene()


@pytest.fixture(scope="session")
def large_scene() -> Scene:
    """The same with enough photos for decisions during training."""
    return make_scene(N_MANY_VIEWS)


def make_scene(n_views: int = N_VIEWS) -> Scene:
    truth, part = make_truth()
    rng = np.random.default_rng(3)
    views = []
    for index in range(n_views):
        camera = camera_at(2 * np.pi * index / n_views)
        pixels, labels = photograph(truth, part, camera)
        views.append(TrainingView(f"{index:02d}.jpg", camera, pixels, LabelRuns.of(labels), is_held_out(index, 8)))
    chosen = rng.choice(len(truth), 200, replace=False)
    start = gaussians_from_points(
        truth.means[chosen] + rng.normal(0, 0.03, (200, 3)),
        np.full((200, 3), 128, np.uint8),
        InitialValues(sh_degree=0, feature_dim=16),
        seed=0,
        max_gaussians=300,
    )
    return Scene(truth, part, views, start)


def shiny(scene: Scene) -> list[TrainingView]:
    """Photos of the scene whose colours change with the side they are seen from."""
    truth, part = make_truth()
    sh = np.concatenate([truth.sh, np.zeros((len(truth), 3, 3), np.float32)], axis=1)
    sh[:, 1] = 0.35
    sh[:, 3] = -0.35
    changing = Gaussians(truth.means, truth.log_scales, truth.quats, truth.opacity_logits, sh)
    photos = [photograph(changing, part, camera_at(2 * np.pi * i / N_MANY_VIEWS))[0] for i in range(N_MANY_VIEWS)]
    return [replace(view, pixels=photo) for view, photo in zip(scene.views, photos, strict=True)]


@pytest.fixture(scope="session")
def trained_with_bands(large_scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> TrainingResult:
    """What `BANDS` makes of `shiny` photos."""
    folder = tmp_path_factory.mktemp("bands")
    return train(
        large_scene.start, shiny(large_scene), BANDS, checkpoints=folder, emit=ignore_events, should_stop=never_stop
    )
