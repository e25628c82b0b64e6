"""Tiny scenes: Gaussians in float64 with float32 values, and a camera."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...rasterizer import Raster, rasterize
from ...rasterizer.settings import Backend, RasterSettings
from ...scene import PinholeCamera

NAMES = ("means", "quats", "scales", "opacities", "sh", "channels")

ONE_THREAD = RasterSettings(threads=1)
"""Settings of the rasterizer in all scenes that need no others."""


@dataclass(frozen=True)
class Scene:
    """N Gaussians, a camera, and settings of the rasterizer.

    Attributes
    ----------
    means, quats, scales, opacities, sh, channels : float64 tensors
        Inputs of `engine.rasterizer.rasterize`. They are float32 values, so that both backends get the same numbers,
        except in cases that test the rounding of the inputs.
    camera : PinholeCamera
    settings : RasterSettings
    """

    means: torch.Tensor
    quats: torch.Tensor
    scales: torch.Tensor
    opacities: torch.Tensor
    sh: torch.Tensor
    channels: torch.Tensor
    camera: PinholeCamera
    settings: RasterSettings = field(default=ONE_THREAD)

    def tensors(self) -> dict[str, torch.Tensor]:
        """Return the six arrays by name."""
        return {name: getattr(self, name) for name in NAMES}

    def with_arrays(self, **arrays: Any) -> Scene:
        """Return the scene with some arrays replaced by values that are rounded to float32."""
        rounded = {name: _float32_values(value) for name, value in arrays.items()}
        return replace(self, **rounded)

    def rows(self, index: torch.Tensor | slice) -> Scene:
        """Return the scene with the Gaussians that `index` selects, in its order."""
        return replace(self, **{name: value[index] for name, value in self.tensors().items()})

    def cast(self, dtype: torch.dtype) -> Scene:
        """Return the scene with its arrays copied to `dtype` as leaves that collect gradients."""
        return replace(
            self, **{name: value.detach().to(dtype).requires_grad_() for name, value in self.tensors().items()}
        )

    def render(self, backend: Backend) -> Raster:
        """Render with one of the backends, in the dtype of the arrays."""
        return rasterize(
            self.means,
            self.quats,
            self.scales,
            self.opacities,
            sh=self.sh,
            channels=self.channels,
            camera=self.camera,
            backend=backend,
            settings=self.settings,
        )


def _float32_values(values: Any) -> torch.Tensor:
    return torch.tensor(np.asarray(values, np.float32).astype(np.float64))


def facing_camera(width: int = 40, height: int = 30, *, focal: float = 50.0) -> PinholeCamera:
    """Return a camera at the origin that looks along z, so that the depth of a Gaussian is exactly its z."""
    k = np.array([[focal, 0.0, 0.5 * width], [0.0, focal, 0.5 * height], [0.0, 0.0, 1.0]])
    return PinholeCamera(np.eye(4), k, width, height)


def slanted_camera(width: int = 40, height: int = 30, *, focal: float = 50.0) -> PinholeCamera:
    """Return a camera near the origin, rotated by 0.1 radians, with an off-centre principal point."""
    c, s = np.cos(0.1), np.sin(0.1)
    viewmat = np.eye(4)
    viewmat[:3, :3] = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
    viewmat[:3, 3] = [-0.2, 0.1, 0.3]
    k = np.array([[focal, 0.0, 0.4 * width], [0.0, 1.1 * focal, 0.55 * height], [0.0, 0.0, 1.0]])
    return PinholeCamera(viewmat, k, width, height)


def ordinary_scene(n: int = 24, *, camera: PinholeCamera | None = None) -> Scene:
    """Return `n` ordinary Gaussians 3 units in front of the camera, with harmonics up to band 1 and two channels."""
    rng = np.random.default_rng(0)
    arrays: dict[str, NDArray[np.float64]] = {
        "means": rng.uniform(-1.0, 1.0, (n, 3)) * [0.7, 0.5, 0.6] + [0.0, 0.0, 3.0],
        "quats": rng.normal(size=(n, 4)),
        "scales": 0.12 * np.exp(0.5 * rng.normal(size=(n, 3))),
        "opacities": 1.0 / (1.0 + np.exp(-1.5 * rng.normal(size=n))),
        "sh": 0.3 * rng.normal(size=(n, 4, 3)),
        "channels": rng.normal(size=(n, 2)),
    }
    return Scene(**{name: _float32_values(value) for name, value in arrays.items()}, camera=camera or slanted_camera())
