"""Training as gsplat 1.5 does it, with its own rates and the strategy of Kheradmand et al. 2024, on the same views."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from scipy.spatial import cKDTree

from engine.core.errors import EnvironmentProblem
from engine.formats import SH_C0
from engine.scene import CameraSet, Gaussians
from engine.training import Coverage, Parameters
from engine.training.held_out import render_picture
from engine.training.quality import measure_levels
from engine.training.settings import LAMBDA_DSSIM, TrainingSettings
from engine.training.views import TrainingView, ViewPyramid, scene_extent

DEVICE = "cuda"

GSPLAT = "gsplat"
"""Name of its trainings in results and tables."""

_SH_DEGREE = 3
_OF_30_000 = {"refine_start_iter": 500, "refine_stop_iter": 25_000, "refine_every": 100, "sh_interval": 1000}
"""Steps of gsplat's own schedule of 30,000 steps; ours are scaled to the steps that are made."""
_MIN_REFINE_START, _MIN_REFINE_EVERY = 150, 20
"""Limits of the scaled schedule."""
_LAMBDA_OPACITY = _LAMBDA_SCALE = 0.01
_START_SCALE, _START_OPACITY = 0.1, 0.5


def train_gsplat(
    cameras: CameraSet, views: Sequence[TrainingView], *, steps: int, max_gaussians: int, seed: int
) -> Gaussians:
    """Return Gaussians trained by gsplat's own rasterizer, rates, losses and strategy, with bands up to 3.

    Parameters
    ----------
    cameras : CameraSet
        Its sparse points are the start.
    views : sequence of TrainingView
        Held-out ones are not used.
    steps, max_gaussians, seed : int

    Raises
    ------
    EnvironmentProblem
        When gsplat or fused-ssim is not installed.

    Notes
    -----
    As in gsplat's own trainer, SSIM is the fused one, and no step waits for the card.
    """
    try:
        from fused_ssim import fused_ssim
        from gsplat import rasterization
        from gsplat.strategy import MCMCStrategy
    except ImportError as error:
        raise EnvironmentProblem(f"Training as gsplat does it needs gsplat 1.5 and fused-ssim ({error}).") from error

    torch.manual_seed(seed)
    training = [view for view in views if not view.held_out]
    photos = [torch.from_numpy(np.array(view.pixels)).to(DEVICE).float() / 255.0 for view in training]
    viewmats, intrinsics = (
        torch.tensor(np.stack(matrices), dtype=torch.float32, device=DEVICE)
        for matrices in ([view.pinhole.viewmat for view in training], [view.pinhole.K for view in training])
    )
    extent = scene_extent([view.pinhole for view in training])
    values = torch.nn.ParameterDict(_start(cameras)).to(DEVICE)
    rates = {
        "means": 1.6e-4 * extent, "scales": 5e-3, "quats": 1e-3, "opacities": 5e-2, "sh0": 2.5e-3, "shN": 2.5e-3 / 20,
    }  # fmt: skip
    optimizers: dict[str, torch.optim.Optimizer] = {
        name: torch.optim.Adam([{"params": values[name], "lr": rate, "name": name}], eps=1e-15, fused=True)
        for name, rate in rates.items()
    }
    falling = torch.optim.lr_scheduler.ExponentialLR(optimizers["means"], gamma=0.01 ** (1.0 / steps))
    scaled = {name: int(value * steps / 30_000) for name, value in _OF_30_000.items()}
    strategy = MCMCStrategy(
        cap_max=max_gaussians, verbose=False, refine_stop_iter=scaled["refine_stop_iter"],
        refine_start_iter=max(_MIN_REFINE_START, scaled["refine_start_iter"]),
        refine_every=max(_MIN_REFINE_EVERY, scaled["refine_every"]),
    )  # fmt: skip
    strategy.check_sanity(values, optimizers)
    state: dict[str, Any] = strategy.initialize_state()
    order: list[int] = []
    for step in range(steps):
        order = order or torch.randperm(len(training)).tolist()
        view = order.pop()
        camera = training[view].pinhole
        scales, opacities = values["scales"].exp(), values["opacities"].sigmoid()
        image, _, info = rasterization(
            values["means"], values["quats"], scales, opacities, torch.cat([values["sh0"], values["shN"]], dim=1),
            viewmats[view : view + 1], intrinsics[view : view + 1], camera.width, camera.height,
            sh_degree=min(step // max(1, scaled["sh_interval"]), _SH_DEGREE), packed=False,
        )  # fmt: skip
        colors = photos[view]
        similarity = fused_ssim(image.permute(0, 3, 1, 2), colors.permute(2, 0, 1)[None].contiguous(), padding="valid")
        loss = (1.0 - LAMBDA_DSSIM) * (image[0] - colors).abs().mean() + LAMBDA_DSSIM * (1.0 - similarity)
        loss = loss + _LAMBDA_OPACITY * opacities.mean() + _LAMBDA_SCALE * scales.mean()
        loss.backward()  # type: ignore[no-untyped-call]
        for optimizer in optimizers.values():
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        falling.step()
        strategy.step_post_backward(values, optimizers, state, step, info, lr=falling.get_last_lr()[0])
    found = {name: value.detach().cpu().numpy() for name, value in values.items()}
    lengths = np.linalg.norm(found["quats"], axis=1, keepdims=True)
    sh = np.concatenate([found["sh0"], found["shN"]], axis=1)
    return Gaussians(found["means"], found["scales"], found["quats"] / lengths, found["opacities"], sh)


def measured_figures(
    gaussians: Gaussians, views: Sequence[TrainingView], settings: TrainingSettings
) -> dict[str, float]:
    """Return PSNR, fitted PSNR, SSIM and the share of dark pixels on the held-out views, by our rasterizer."""
    values = Parameters.from_gaussians(gaussians, sh_degree=gaussians.sh_degree, features=False).values
    coverage = Coverage(values, [view.pinhole for view in views if not view.held_out])
    pyramid = ViewPyramid([view for view in views if view.held_out], settings.features)
    levels = [pyramid.level(index, 0) for index in range(len(pyramid.views))]
    picture = functools.partial(render_picture, values, backend=settings.backend, sh_degree=gaussians.sh_degree)
    measured = measure_levels(picture, levels, coverage)
    return {
        "psnr": measured.quality.psnr, "fitted_psnr": measured.fitted.psnr, "ssim": measured.quality.ssim,
        "dark_share": measured.dark_share,
    }  # fmt: skip


def _start(cameras: CameraSet) -> dict[str, torch.nn.Parameter]:
    points = np.asarray(cameras.points, np.float32)
    distances = cKDTree(points).query(points, k=4)[0][:, 1:]
    scales = np.log(np.maximum(np.sqrt(np.square(distances).mean(axis=1)), 1e-7) * _START_SCALE)
    values = {
        "means": points,
        "scales": np.repeat(scales[:, None], 3, axis=1),
        "quats": np.random.default_rng(0).random((len(points), 4)),
        "opacities": np.full(len(points), np.log(_START_OPACITY / (1.0 - _START_OPACITY))),
        "sh0": ((cameras.point_colors / 255.0 - 0.5) / SH_C0)[:, None],
        "shN": np.zeros((len(points), (_SH_DEGREE + 1) ** 2 - 1, 3)),
    }
    return {name: torch.nn.Parameter(torch.tensor(value, dtype=torch.float32)) for name, value in values.items()}
