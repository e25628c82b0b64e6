"""What the steps of detail share on every device: weights, rates, limits, and which Gaussians a window may show."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from ..core.arrays import Float32
from ..scene import Gaussians, PinholeCamera
from .parameters import Parameters

COVERAGE_WEIGHT = 0.3  # chosen on museum_room
"""Weight of the coverage's L1 distance relative to the photometric loss."""

KEPT_WEIGHT = 1.0  # chosen on museum_room
"""Weight of the coverage that is missing where the object keeps what others show as well."""

ALONE_WEIGHT = 1.0  # chosen on museum_room
"""Weight of the photometric loss of the object alone, inside of its outline, relative to that within the scene."""

LEARNING_RATES = {
    "means": 0.03,  # in units of the Gaussians' median scale
    "log_scales": 0.01,
    "quats": 0.003,
    "opacity_logits": 0.05,
    "sh_dc": 0.006,
    "sh_rest": 0.001,
}  # chosen on museum_room
"""Learning rates of the first step."""

_MAX_NEEDLE = 4.0
"""Largest ratio of the longest to the middle scale of a Gaussian: longer ones are seen as straw."""

_MAX_FLAT = 50.0
"""Largest ratio of the middle to the shortest scale: a surface is flat."""

_MAX_SCALE = 0.2  # chosen on museum_room
"""Largest scale of a Gaussian, in the radius of the object."""

_MAX_LOGIT = 8.0
"""Largest absolute opacity logit."""

_BOX_MARGIN = 0.03
"""Distance that a centre may leave the box of the object's Gaussians, as a share of the radius."""

_REACH = 3.0
"""Standard deviations beyond which a Gaussian does not reach into a window."""

_NEAREST = 0.01
"""Smallest depth at which a Gaussian may be in a window, world units."""


def rows_in_window(means: Float32, reach: Float32, camera: PinholeCamera) -> NDArray[np.intp]:
    """Return the Gaussians that may reach into the picture of `camera`: `means` [N, 3], `reach` [N], world units."""
    local = means @ camera.viewmat[:3, :3].T.astype(np.float32) + camera.viewmat[:3, 3].astype(np.float32)
    depth = np.maximum(local[:, 2], _NEAREST)
    radius = reach / depth * np.float32(camera.K[0, 0])
    x, y = (local[:, axis] / depth * camera.K[axis, axis] + camera.K[axis, 2] for axis in (0, 1))
    near = (x > -radius) & (x < camera.width + radius) & (y > -radius) & (y < camera.height + radius)
    return np.flatnonzero(near & (local[:, 2] > -reach))


def reach_of(log_scales: Float32) -> Float32:
    """Return how far Gaussians reach, [N] in world units, of the logarithms of their scales [N, 3]."""
    return np.asarray(_REACH * np.exp(log_scales.max(axis=1)), np.float32)


@dataclass(frozen=True)
class ObjectLimits:
    """What no Gaussian of an object may exceed: a box for its centre, and the largest logarithm of its scales."""

    low: torch.Tensor
    high: torch.Tensor
    log_scale: float

    @classmethod
    def of(cls, gaussians: Gaussians) -> ObjectLimits:
        low, high = gaussians.means.min(axis=0), gaussians.means.max(axis=0)
        inner = np.quantile(gaussians.means, (0.05, 0.95), axis=0)
        radius = max(float(np.linalg.norm(inner[1] - inner[0])) / 2, 1e-6)
        margin = np.float32(_BOX_MARGIN * radius)
        return cls(torch.from_numpy(low - margin), torch.from_numpy(high + margin), math.log(_MAX_SCALE * radius))

    @property
    def values(self) -> list[float]:
        """The limits as in object_limits.wgsl."""
        scales = math.log(_MAX_NEEDLE), math.log(_MAX_FLAT)
        return [*self.low.tolist(), self.log_scale, *self.high.tolist(), _MAX_LOGIT, *scales, 0.0, 0.0]

    def apply(self, parameters: Parameters) -> None:
        """Clamp the Gaussians, in place."""
        values = {name: value.detach() for name, value in parameters.values.items()}
        values["means"].copy_(torch.minimum(torch.maximum(values["means"], self.low), self.high))
        ordered, order = values["log_scales"].sort(dim=1)
        middle = ordered[:, 1].clamp_max(self.log_scale)
        longest = torch.minimum(ordered[:, 2], middle + math.log(_MAX_NEEDLE)).clamp_max(self.log_scale)
        shortest = torch.minimum(torch.maximum(ordered[:, 0], middle - math.log(_MAX_FLAT)), middle)
        clamped = torch.stack([shortest, middle, longest], dim=1)
        values["log_scales"].copy_(torch.empty_like(clamped).scatter_(1, order, clamped))
        values["opacity_logits"].clamp_(-_MAX_LOGIT, _MAX_LOGIT)
        values["quats"].div_(values["quats"].norm(dim=1, keepdim=True).clamp_min(1e-6))


def median_scale(log_scales: torch.Tensor) -> float:
    """Return the median of the scales of Gaussians, [N, 3], by which the rate of the means is multiplied."""
    return math.exp(float(log_scales.detach().median()))
