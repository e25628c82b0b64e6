"""Small scenes for the rasterizer's tests."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from engine.rasterizer.api import rasterize
from engine.rasterizer.raster import Raster
from engine.rasterizer.settings import RasterSettings
from engine.scene.camera import PinholeCamera

NAMES = ("means", "quats", "scales", "opacities", "sh", "channels")


@dataclass(frozen=True)
class Scene:
    """Gaussians as float32 tensors; `sh` or `channels` may be None."""

    means: torch.Tensor
    quats: torch.Tensor
    scales: torch.Tensor
    opacities: torch.Tensor
    sh: torch.Tensor | None
    channels: torch.Tensor | None

    def tensors(self) -> dict[str, torch.Tensor]:
        """Return the tensors that are not None, by name."""
        return {name: getattr(self, name) for name in NAMES if getattr(self, name) is not None}

    def leaves(self, dtype: torch.dtype) -> Scene:
        """Return a copy with tensors of `dtype` that collect gradients."""
        return replace(self, **{name: t.detach().to(dtype).requires_grad_() for name, t in self.tensors().items()})

    def render(
        self, camera: PinholeCamera, backend: str = "cpu", settings: RasterSettings | None = None, **options: object
    ) -> Raster:
        """Rasterize the scene."""
        return rasterize(
            self.means,
            self.quats,
            self.scales,
            self.opacities,
            sh=self.sh,
            channels=self.channels,
            camera=camera,
            backend=backend,  # type: ignore[arg-type]
            settings=settings,
            **options,  # type: ignore[arg-type]
        )


def random_scene(n: int, *, n_features: int = 0, colored: bool = True, seed: int = 0, size: float = 0.07) -> Scene:
    """Return `n` Gaussians around a point 3 units from the origin along z."""
    rng = np.random.default_rng(seed)

    def tensor(values: object) -> torch.Tensor:
        return torch.tensor(np.asarray(values), dtype=torch.float32)

    return Scene(
        means=tensor(rng.normal(size=(n, 3)) * [1.0, 0.8, 0.5] + [0, 0, 3.0]),
        quats=tensor(rng.normal(size=(n, 4))),
        scales=tensor(size * np.exp(0.5 * rng.normal(size=(n, 3)))),
        opacities=tensor(1 / (1 + np.exp(-1.5 * rng.normal(size=n)))),
        sh=tensor(0.3 * rng.normal(size=(n, 16, 3))) if colored else None,
        channels=tensor(rng.normal(size=(n, n_features))) if n_features else None,
    )


def camera(width: int, height: int, *, focal: float | None = None, off_center: bool = True) -> PinholeCamera:
    """Return a camera near the origin that looks roughly along z."""
    focal = focal or 0.9 * max(width, height)
    cx, cy = (0.4 * width, 0.55 * height) if off_center else (width / 2, height / 2)
    angle = 0.1
    viewmat = np.eye(4)
    viewmat[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    viewmat[:3, 3] = [-0.2, 0.1, 0.3]
    return PinholeCamera(viewmat, np.array([[focal, 0, cx], [0, 1.1 * focal, cy], [0, 0, 1]]), width, height)


def gradients(
    scene: Scene, view: PinholeCamera, dtype: torch.dtype, backend: str, seed: int = 5, **options: object
) -> tuple[Raster, dict[str, torch.Tensor]]:
    """Return the render and the gradients of a random linear function of image and transmittance."""
    leaves = scene.leaves(dtype)
    raster = leaves.render(view, backend, **options)  # type: ignore[arg-type]
    generator = torch.Generator().manual_seed(seed)
    by_image = torch.randn(raster.image.shape, generator=generator)
    by_transmittance = torch.randn(raster.transmittance.shape, generator=generator)
    total = (raster.image * by_image.to(dtype)).sum() + (raster.transmittance * by_transmittance.to(dtype)).sum()
    total.backward()
    tensor_gradients = {}
    for name, tensor in leaves.tensors().items():
        assert tensor.grad is not None
        tensor_gradients[name] = tensor.grad
    return replace(raster, image=raster.image.detach(), transmittance=raster.transmittance.detach()), tensor_gradients
