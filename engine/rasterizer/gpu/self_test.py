"""Opening of a graphics card for use: a small picture and its gradients are compared with the ``cpu`` backend first."""

from __future__ import annotations

import functools

import numpy as np
import torch

from ...core.errors import EnvironmentProblem
from ...core.parts import part
from ...scene import PinholeCamera
from ..cpu import rasterize_cpu
from ..raster import RasterInputs
from ..settings import RasterSettings
from .adapters import Gpu, open_adapter, translate_card_errors
from .autograd import rasterize_gpu
from .tested import has_passed_elsewhere

TOLERANCE = 1e-3
"""Largest relative difference (Euclidean norms) from the CPU. Rounding causes 1e-6, one flipped pixel at most 1e-3."""


@torch.enable_grad()
def check_gpu(gpu: Gpu) -> None:
    """Raise `EnvironmentProblem` if a picture or a gradient of `gpu` differs from that of the CPU."""
    rng = np.random.default_rng(0)
    values = (
        rng.normal(size=(200, 3)) * [1.0, 0.8, 0.5] + [0, 0, 3.0],
        rng.normal(size=(200, 4)),
        0.07 * np.exp(0.5 * rng.normal(size=(200, 3))),
        rng.uniform(0.05, 0.95, 200),
        0.3 * rng.normal(size=(200, 16, 3)),
    )
    camera = PinholeCamera(np.eye(4), np.array([[60.0, 0, 32], [0, 60, 24], [0, 0, 1]]), 64, 48)
    found = []
    for render in (rasterize_cpu, lambda inputs: rasterize_gpu(inputs, gpu)):
        leaves = [torch.tensor(value, dtype=torch.float32, requires_grad=True) for value in values]
        means, quats, scales, opacities, sh = leaves
        raster = render(
            RasterInputs(means, quats, scales, opacities, sh, None, torch.eye(4).double(), camera, 3, RasterSettings())
        )
        (raster.image.square().sum() + raster.transmittance.sum()).backward()
        found.append([raster.image.detach(), *(leaf.grad for leaf in leaves)])
    for expected, ours in zip(*found, strict=True):
        if not float((ours - expected).norm()) <= TOLERANCE * float(expected.norm()):
            raise EnvironmentProblem(
                f"the graphics card {gpu.name} (driver {gpu.driver}) computes a test picture wrongly; use the CPU or "
                "update the driver."
            )


@functools.lru_cache(maxsize=2)
def open_gpu(*, software: bool = False) -> Gpu:
    """Open the best graphics card after a self-test; `software` also accepts the processor, for tests.

    A card that passed it in another process of the run, see `passed_elsewhere`, is not tested again.

    Raises
    ------
    EnvironmentProblem
        If there is no card, or it fails the self-test.
    """
    with part("opening the card"):
        gpu = open_adapter(software=software)
    if not has_passed_elsewhere(f"{gpu.name} ({gpu.backend})"):
        with part("self-test of the card"), translate_card_errors(gpu, "use the CPU or update the driver"):
            check_gpu(gpu)
    return gpu
