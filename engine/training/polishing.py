"""Further training of some Gaussians on pictures that show them alone, with their coverage, for polished objects.

See `engine.objects.polishing`, which makes the pictures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from ..core.errors import Cancelled
from ..core.events import StopCheck
from ..rasterizer.settings import Backend
from ..scene import Gaussians, PinholeCamera
from .parameters import Parameters, render

__all__ = ["AloneTarget", "train_alone"]

_COVERAGE_WEIGHT = 0.5  # chosen on museum_room
"""Weight of the coverage's L1 distance relative to that of the colours."""

_LEARNING_RATES = {
    "means": 0.03,  # in units of the Gaussians' median scale
    "log_scales": 0.02,
    "quats": 0.0006,
    "opacity_logits": 0.1,
    "sh_dc": 0.005,
    "sh_rest": 0.0005,
}  # chosen on museum_room
"""Learning rates of the first step."""

_FINAL_RATE_FACTOR = 0.1  # chosen on museum_room
"""Learning rate at the end, relative to the first step. The rates fall exponentially."""


@dataclass(frozen=True)
class AloneTarget:
    """What Gaussians look like alone in a part of one view.

    Attributes
    ----------
    camera : PinholeCamera
        Camera of the part, [h, w].
    image : tensor of shape [h, w, 3]
        Colours over black.
    alpha : tensor of shape [h, w]
        Coverage.
    known : tensor of shape [h, w]
        1 for pixels that count, 0 where something hides the Gaussians.
    """

    camera: PinholeCamera
    image: torch.Tensor
    alpha: torch.Tensor
    known: torch.Tensor


def train_alone(
    gaussians: Gaussians, targets: Sequence[AloneTarget], *, steps: int, backend: Backend, should_stop: StopCheck
) -> Gaussians:
    """Return Gaussians that look, rendered alone, more like their targets.

    Parameters
    ----------
    gaussians : Gaussians
        Without features.
    targets : sequence of AloneTarget
        At least one; each step takes one of them.
    steps : int
    backend : {"cpu", "reference"}
    should_stop : callable

    Raises
    ------
    Cancelled
        When `should_stop` returns True.

    Notes
    -----
    The loss of a step is the L1 distance of the colours over black to their target, plus one half of that of the
    coverage.
    """
    parameters = Parameters.from_gaussians(gaussians, sh_degree=gaussians.sh_degree, features=False)
    rates = {**_LEARNING_RATES, "means": _LEARNING_RATES["means"] * float(np.exp(np.median(gaussians.log_scales)))}
    random = np.random.default_rng(0)
    order: list[int] = []
    for step in range(steps):
        if should_stop():
            raise Cancelled("Stopped while polishing; no object was stored.")
        order = order or random.permutation(len(targets)).tolist()
        target = targets[order.pop()]
        parameters.track()
        raster = render(parameters.values, target.camera, backend=backend, sh_degree=gaussians.sh_degree)
        color = (raster.image - target.image).abs() * target.known[..., None]
        coverage = (1 - raster.transmittance - target.alpha).abs() * target.known
        (color.mean() + _COVERAGE_WEIGHT * coverage.mean()).backward()  # type: ignore[no-untyped-call]
        factor = _FINAL_RATE_FACTOR ** (step / steps)
        parameters.step({name: factor * rate for name, rate in rates.items()})
    return parameters.to_gaussians(unit_features=False)
