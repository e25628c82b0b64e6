"""The reference is right: its gradients match finite differences, and its image matches the formula."""

from __future__ import annotations

import math

import numpy as np
import torch

from engine.rasterizer.reference import evaluate_sh
from engine.scene.camera import PinholeCamera

from .scenes import NAMES, Scene, camera, random_scene


def test_gradients_are_those_of_finite_differences() -> None:
    scene = random_scene(3, n_features=2, size=0.4).leaves(torch.float64)
    scene.opacities.data.clamp_(0.1, 0.9)
    view = camera(5, 4)
    weights = torch.randn(4, 5, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(1))

    def total(*tensors: torch.Tensor) -> torch.Tensor:
        raster = Scene(**dict(zip(NAMES, tensors, strict=True))).render(view, "reference")
        return (raster.image * weights[..., :5]).sum() + (raster.transmittance * weights[..., 5]).sum()

    torch.autograd.gradcheck(total, tuple(scene.tensors().values()), eps=1e-6, atol=1e-5, rtol=1e-4)


def test_one_gaussian_in_the_middle_has_the_alpha_of_the_formula() -> None:
    """A ball of sigma 0.1 at distance 2 with focal length 100 has sigma 5 on the screen; the low pass adds 0.3."""
    view = PinholeCamera(np.eye(4), np.array([[100.0, 0, 8], [0, 100, 8], [0, 0, 1]]), 16, 16)
    scene = Scene(
        means=torch.tensor([[0.0, 0.0, 2.0]]),
        quats=torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        scales=torch.full((1, 3), 0.1),
        opacities=torch.tensor([0.8]),
        sh=None,
        channels=torch.tensor([[3.0]]),
    )
    for backend in ("reference", "cpu"):
        raster = scene.render(view, backend)
        alpha = 0.8 * math.exp(-0.5 * (2 * 0.5**2) / 25.3)
        assert abs(float(raster.image[8, 8, 0]) - 3.0 * alpha) < 1e-5
        assert abs(float(raster.transmittance[8, 8]) - (1 - alpha)) < 1e-6
        assert abs(float(raster.radii[0]) - 3 * math.sqrt(25.3)) < 1e-4


def test_harmonics_are_orthonormal() -> None:
    """The integral of Y_i Y_j over the sphere is 1 for i = j, else 0 (Gauss-Legendre times uniform longitudes)."""
    z, z_weights = np.polynomial.legendre.leggauss(8)
    longitude = 2 * np.pi * np.arange(16) / 16
    radius = np.sqrt(1 - z**2)
    directions = np.stack(
        [np.outer(radius, np.cos(longitude)), np.outer(radius, np.sin(longitude)), np.outer(z, np.ones(16))], axis=2
    ).reshape(-1, 3)
    weights = torch.tensor(np.repeat(z_weights, 16) * 2 * np.pi / 16)
    unit = torch.eye(16, dtype=torch.float64)
    values = torch.stack(
        [
            evaluate_sh(unit[k].reshape(1, 16, 1).expand(len(directions), 16, 3), torch.tensor(directions), 3)[:, 0]
            for k in range(16)
        ]
    )
    torch.testing.assert_close((values * weights) @ values.T, unit, rtol=0, atol=1e-12)
