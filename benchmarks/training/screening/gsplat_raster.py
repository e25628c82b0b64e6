"""gsplat's rasterizer in place of ours in the training loop, and the loss on the GPU.

Parameters, Adam and growth stay on the CPU, as the loop has them. gsplat (Apache-2.0) is not installed by `make setup`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from types import SimpleNamespace
from unittest import mock

import numpy as np
import torch
from numpy.typing import NDArray

from engine.rasterizer import cpu
from engine.rasterizer.raster import RasterInputs
from engine.training import loop, step, views
from engine.training.settings import LAMBDA_DSSIM

DEVICE = "cuda"

_WINDOW = 11
_SIGMA = 1.5
_C1, _C2 = 0.01**2, 0.03**2
"""Window and constants of SSIM (Wang et al. 2004)."""


class GpuTarget:
    """A photo on the GPU, [H, W, 3] in [0, 1]; it stands for `engine.rasterizer.Target`.

    Raises
    ------
    ValueError
        When pixels are masked, which the loss on the GPU does not do.
    """

    def __init__(self, pixels: NDArray[np.uint8], *, valid: NDArray[np.bool_] | None = None) -> None:
        if valid is not None:
            raise ValueError("photos with masks cannot be trained on the GPU")
        self.colors = torch.from_numpy(np.array(pixels)).to(DEVICE).float() / 255.0


def rasterize(inputs: RasterInputs) -> SimpleNamespace:
    """Render as `engine.rasterizer.cpu.rasterize_cpu` does; return image and transmittance on the CPU."""
    from gsplat import rasterization, spherical_harmonics

    camera, settings, channels = inputs.camera, inputs.settings, inputs.channels
    geometry = [value.to(DEVICE) for value in (inputs.means, inputs.quats, inputs.scales, inputs.opacities)]
    viewmat, intrinsics = (torch.from_numpy(np.asarray(m, np.float32)).to(DEVICE) for m in (camera.viewmat, camera.K))

    def blend(shape: list[torch.Tensor], values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        image, alpha, _ = rasterization(
            *shape, values, viewmat[None], intrinsics[None], camera.width, camera.height,
            near_plane=settings.near, eps2d=settings.low_pass, packed=False,
        )  # fmt: skip
        return image[0].cpu(), 1.0 - alpha[0, ..., 0].cpu()

    blended = []
    if inputs.sh is not None:
        center = torch.from_numpy(np.asarray(camera.center, np.float32)).to(DEVICE)
        colors = spherical_harmonics(inputs.sh_degree, geometry[0] - center, inputs.sh.to(DEVICE))
        blended.append((colors + 0.5).clamp_min(0.0))
    if channels is not None and inputs.detached_channels and blended:
        image, transmittance = blend(geometry, blended[0])
        features, _ = blend([value.detach() for value in geometry], channels.to(DEVICE))
        return SimpleNamespace(image=torch.cat([image, features], dim=2), transmittance=transmittance)
    if channels is not None:
        blended.append(channels.to(DEVICE))
    image, transmittance = blend(geometry, torch.cat(blended, dim=1))
    return SimpleNamespace(image=image, transmittance=transmittance)


def photometric_loss(image: torch.Tensor, target: GpuTarget, *, lambda_dssim: float = LAMBDA_DSSIM) -> torch.Tensor:
    """Return the loss of `engine.training.photometric_loss`, computed on the GPU."""
    x, y = (picture.permute(2, 0, 1)[None] for picture in (image.to(DEVICE), target.colors))
    return ((1.0 - lambda_dssim) * (x - y).abs().mean() + lambda_dssim * (1.0 - ssim(x, y))).cpu()


def ssim(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
    """Return the mean SSIM of two pictures [1, 3, H, W] on the same device."""
    offsets = torch.arange(_WINDOW, device=x.device) - _WINDOW // 2
    weights = torch.exp(-(offsets**2) / (2 * _SIGMA**2))
    window = torch.outer(weights, weights) / weights.sum() ** 2
    maps = torch.cat([x, y, x * x, y * y, x * y], dim=1)
    blurred = torch.nn.functional.conv2d(maps, window.repeat(15, 1, 1, 1), padding=_WINDOW // 2, groups=15)
    mean_x, mean_y, xx, yy, xy = blurred.split(3, dim=1)
    covariance, variances = xy - mean_x * mean_y, xx + yy - mean_x**2 - mean_y**2
    similar = (2 * mean_x * mean_y + _C1) * (2 * covariance + _C2)
    return (similar / ((mean_x**2 + mean_y**2 + _C1) * (variances + _C2))).mean()


@contextlib.contextmanager
def gsplat_in_training() -> Iterator[None]:
    """Use gsplat's rasterizer and the loss on the GPU in `engine.training` within the ``with`` block."""
    with (
        mock.patch.object(cpu, "rasterize_cpu", rasterize),
        mock.patch.object(step, "photometric_loss", photometric_loss),
        mock.patch.object(views, "Target", GpuTarget),
        mock.patch.object(loop, "compile_kernels", lambda: None),
    ):
        yield
