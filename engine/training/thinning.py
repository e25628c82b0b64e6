"""Removal of the Gaussians without which the pictures change least, so that the rest of training needs fewer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch

from ..rasterizer.settings import Backend
from ..scene import PinholeCamera
from .parameters import Parameters, render

MAX_CAMERAS, SIDE = 24, 320
"""Largest number of cameras that changes are measured from, and longest side of their pictures, pixels."""

_PROBES = 2
"""Draws of signs for each picture."""


def changes_by_removal(
    values: Mapping[str, torch.Tensor],
    cameras: Sequence[PinholeCamera],
    *,
    backend: Backend,
    sh_degree: int,
    generator: torch.Generator,
) -> torch.Tensor:
    """Return an estimate of how much the pictures change without each Gaussian alone, float32 [N].

    Parameters
    ----------
    values : mapping of str to tensor
        As in `Parameters.values`.
    backend : {"cpu", "gpu", "reference"}

    Notes
    -----
    A picture I is linear in the opacity o of each Gaussian, so removing it changes a pixel by exactly ``o dI/do``. With
    a random sign s for each value of the picture, the square of ``o d(sum s I)/do`` has the sum of the squared changes
    as its mean. One backward pass gives it for all Gaussians. A sum of blending weights does not see that a Gaussian
    has the colour of what is behind it.
    """
    constant = {name: value.detach() for name, value in values.items()}
    opacities = constant["opacity_logits"].sigmoid().requires_grad_(True)
    total = torch.zeros(len(opacities))
    with torch.enable_grad():
        for camera in cameras:
            raster = render(constant, camera, backend=backend, sh_degree=sh_degree, opacities=opacities)
            picture = raster.image[..., :3]
            for probe in range(_PROBES):
                signs = torch.randint(0, 2, picture.shape, generator=generator) * 2.0 - 1.0
                kept = probe + 1 < _PROBES
                (gradient,) = torch.autograd.grad((picture * signs).sum(), opacities, retain_graph=kept)
                total += (opacities.detach() * gradient).square() / _PROBES
    return total


def thin(parameters: Parameters, changes: torch.Tensor, n: int) -> None:
    """Keep the background and those of the largest `changes`, [N], `n` Gaussians in all; none is removed below that."""
    if n >= len(parameters):
        return
    wanted = changes.clone()
    wanted[: parameters.n_background] = torch.inf
    parameters.keep(wanted.topk(max(n, parameters.n_background)).indices.sort().values)
