"""Training of some Gaussians of a scene on parts of its photos at the photos' own resolution, the others frozen.

See `engine.objects.detail`, which cuts the parts out of the photos.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from ..core.errors import Cancelled
from ..core.events import StopCheck
from ..rasterizer import rasterize
from ..rasterizer.settings import Backend, RasterSettings
from ..scene import Gaussians, PinholeCamera
from .adam import BETAS, EPS, AdamState
from .densify import split
from .detail_crops import DetailCrop, DetailPlan, Levels
from .detail_rules import (
    ALONE_WEIGHT,
    COVERAGE_WEIGHT,
    KEPT_WEIGHT,
    LEARNING_RATES,
    ObjectLimits,
    median_scale,
    reach_of,
    rows_in_window,
)
from .guards import backward, step_finite_rows
from .losses import Target, photometric_loss
from .parameters import Parameters

_FINAL_RATE_FACTOR = 0.1  # chosen on museum_room
"""Learning rate at the end, relative to the first step. The rates fall exponentially."""

_N_GROWTHS = 6
"""How often Gaussians are split."""

_GROW_UNTIL = 0.6  # chosen on museum_room
"""Share of the steps after which none is split any more."""

_MOST = 0.7
"""Share of the object's Gaussians in a window from which on all are stepped, which then takes less time."""


class DetailSteps(Protocol):
    """Training steps of an object on a device. `LEARNING_RATES` are multiplied by the factor of a step."""

    def __len__(self) -> int:
        """Return the present number of Gaussians of the object."""

    def step(self, crop: DetailCrop, factor: float) -> None:
        """Make one step, or queue it."""

    def grow(self, n_new: int) -> None:
        """Split up to `n_new` Gaussians, drawn by their error."""

    def result(self) -> tuple[Gaussians, NDArray[np.int64]]:
        """Return the Gaussians of the object, and for each the one that it was split from, or is."""


class _Frozen:
    """Gaussians that are drawn and not trained."""

    def __init__(self, gaussians: Gaussians) -> None:
        self._means, self._reach = gaussians.means, reach_of(gaussians.log_scales)
        self._tensors = [
            torch.from_numpy(np.ascontiguousarray(values))
            for values in (gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities, gaussians.sh)
        ]

    def in_window(self, camera: PinholeCamera) -> list[torch.Tensor]:
        """Return means, quats, scales, opacities and sh of those that may reach into the picture of `camera`."""
        rows = torch.from_numpy(rows_in_window(self._means, self._reach, camera))
        return [values[rows] for values in self._tensors]


def train_detail(
    gaussians: Gaussians,
    others: Gaussians,
    crops: Sequence[DetailCrop],
    plan: DetailPlan,
    *,
    backend: Backend,
    should_stop: StopCheck,
    tell: Callable[[float, float | None], None],
) -> tuple[Gaussians, NDArray[np.int64]]:
    """Return Gaussians that look more like the photos, in the scene and alone.

    Parameters
    ----------
    gaussians : Gaussians
        M of the object, without features.
    others : Gaussians
        The rest of the scene, which is drawn with them and stays as it is.
    crops : sequence of DetailCrop
        At least one.
    backend : {"cpu", "gpu", "reference"}
    tell : callable
        Called now and then with the fraction that is done, 0 to 1, and the seconds that are left.

    Returns
    -------
    gaussians : Gaussians
        K of them, the first M of which are the given ones, trained.
    parents : array of shape [K], int
        For each, the one of the M that it was split from, or is.

    Raises
    ------
    Cancelled
        When `should_stop` returns True.
    EnvironmentProblem
        With ``gpu``, when there is no card, its memory is full, or it stops working.

    Notes
    -----
    A step compares a window of one photo. The loss is the photometric loss of the whole scene where the object
    contributes, times the photo's brightness; that of the object alone inside of its outline; and the L1 distance of
    the coverage that it has alone. Windows and rates of the steps are those of `plan` on every device.
    """
    steps: DetailSteps
    if backend == "gpu":
        from .gpu import GpuDetailSteps

        steps = GpuDetailSteps(gaussians, others, crops, plan)
    else:
        steps = _CpuDetailSteps(gaussians, others, backend)
    levels = Levels(crops, plan)
    grow_at = {round(plan.steps * _GROW_UNTIL * (i + 1) / (_N_GROWTHS + 1)): i + 1 for i in range(_N_GROWTHS)}
    started = time.monotonic()
    for step in range(plan.steps):
        if should_stop():
            raise Cancelled("Stopped while detailing; nothing was stored.")
        if step % 20 == 0:
            done = step / plan.steps
            tell(done, (time.monotonic() - started) * (1 - done) / done if step else None)
        crop = levels.draw(step)
        if crop.compared.any():
            steps.step(crop, _FINAL_RATE_FACTOR ** (step / plan.steps))
        if step in grow_at:
            left = plan.max_gaussians - len(steps)
            steps.grow(max(0, math.ceil(left / (_N_GROWTHS + 1 - grow_at[step]))))
    trained, parents = steps.result()
    return replace(trained, antialiased=gaussians.antialiased), parents


class _CpuDetailSteps:
    """See `DetailSteps`. A step touches the Gaussians in its window alone.

    Adam moves and decays the others too, by their moments alone. They are caught up when a window shows them again:
    missing k steps, a value moves by rate times m / sqrt(v) times the sum of b1^j, j from 1 to k, and its moments
    become b1^k m and b2^k v. That is Adam but for the change of v and of the rate meanwhile.
    """

    def __init__(self, gaussians: Gaussians, others: Gaussians, backend: Backend) -> None:
        self._parameters = Parameters.from_gaussians(gaussians, sh_degree=gaussians.sh_degree, features=False)
        self._names = list(self._parameters.values)
        # Copies and halves of a Gaussian inherit all of its values, so also its number. float32 counts to 2^24.
        numbers = torch.arange(len(gaussians), dtype=torch.float32)
        self._parameters.values["parent"] = numbers
        self._parameters.moments["parent"] = AdamState.zeros_like(numbers)
        self._frozen, self._settings = _Frozen(others), RasterSettings(antialiased=gaussians.antialiased)
        self._backend: Backend = backend
        self._limits, self._guards = ObjectLimits.of(gaussians), Counter[str]()
        self._generator = torch.Generator().manual_seed(0)
        self._done, self._rates = 0, dict(LEARNING_RATES)
        self._grown()

    def _grown(self) -> None:
        """Start to count errors, and the steps that rows miss."""
        self._errors = torch.zeros(len(self))
        self._last = torch.full((len(self),), self._done, dtype=torch.int32)
        self._median_scale = median_scale(self._parameters.values["log_scales"])

    def __len__(self) -> int:
        return len(self._parameters)

    def step(self, crop: DetailCrop, factor: float) -> None:
        """See `DetailSteps`."""
        values = self._parameters.values
        self._rates = {name: factor * LEARNING_RATES[name] for name in self._names}
        self._rates["means"] *= self._median_scale
        reach = reach_of(values["log_scales"].detach().numpy())
        rows = torch.from_numpy(rows_in_window(values["means"].detach().numpy(), reach, crop.camera))
        if not len(rows):
            return
        every = len(rows) > _MOST * len(self)
        chosen: torch.Tensor | slice = slice(None) if every else rows
        self._catch_up(chosen)
        part = self._parameters if every else self._part(rows)
        part.track()
        loss, error = _step_loss(part, self._frozen.in_window(crop.camera), crop, self._backend, self._settings)
        self._done += 1
        if not backward(loss, self._guards):
            return
        assert error.grad is not None
        self._errors[chosen] += error.grad[: len(part), 0]
        step_finite_rows(part, lambda: part.step(self._rates), self._guards)
        self._limits.apply(part)
        self._last[chosen] = self._done
        if every:
            return
        for name in self._names:
            values[name].detach()[rows] = part.values[name].detach()
            ours, moment = self._parameters.moments[name], part.moments[name]
            ours.mean[rows], ours.square[rows] = moment.mean, moment.square

    def _part(self, rows: torch.Tensor) -> Parameters:
        """Return copies of some Gaussians, with their moments and the number of all steps."""
        values = {name: self._parameters.values[name].detach()[rows] for name in self._names}
        moments = {}
        for name in self._names:
            moment = self._parameters.moments[name]
            moments[name] = AdamState(moment.mean[rows], moment.square[rows], self._done)
        return Parameters(values, moments)

    def _catch_up(self, rows: torch.Tensor | slice) -> None:
        """Make the steps that Gaussians missed, without gradients."""
        missed = (self._done - self._last[rows]).float()
        if self._done == 0 or not bool((missed > 0).any()):
            self._set_steps()
            return
        beta1, beta2 = BETAS
        decay = beta1**missed
        moved, faded = beta1 * (1 - decay) / (1 - beta1), beta2**missed
        for name in self._names:
            moment, value = self._parameters.moments[name], self._parameters.values[name].detach()
            mean, square = moment.mean[rows], moment.square[rows]
            shape = (-1, *[1] * (mean.ndim - 1))
            # In place where all rows are meant.
            size = self._rates[name] / (1.0 - beta1**self._done)
            root = math.sqrt(1.0 - beta2**self._done)
            value[rows] -= size * moved.view(shape) * mean / (square.sqrt() / root + EPS)
            moment.mean[rows], moment.square[rows] = mean * decay.view(shape), square * faded.view(shape)
        self._last[rows] = self._done
        self._set_steps()

    def _set_steps(self) -> None:
        for name in self._names:
            self._parameters.moments[name].step = self._done

    def grow(self, n_new: int) -> None:
        """See `DetailSteps`."""
        self._catch_up(slice(None))
        split(self._parameters, self._errors, n_new, generator=self._generator)
        self._grown()

    def result(self) -> tuple[Gaussians, NDArray[np.int64]]:
        """See `DetailSteps`."""
        self._catch_up(slice(None))
        self._limits.apply(self._parameters)
        parents = self._parameters.values.pop("parent").detach().numpy().astype(np.int64)
        return self._parameters.to_gaussians(unit_features=False), parents


def _step_loss(
    parameters: Parameters, others: list[torch.Tensor], crop: DetailCrop, backend: Backend, settings: RasterSettings
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the loss, and a channel whose gradient is the error of each Gaussian; `crop` compares some pixel."""
    own = _tensors(parameters)
    joined = [torch.cat(pair) for pair in zip(own, others, strict=True)]
    means, quats, scales, opacities, sh = joined
    channel = torch.zeros(len(means), 1, requires_grad=True)
    gain = torch.from_numpy(crop.gain)
    raster = rasterize(
        means, quats, scales, opacities, sh=sh, camera=crop.camera, channels=channel, detached_channels=True,
        backend=backend, settings=settings,
    )  # fmt: skip
    image = raster.image[..., :3] * gain
    parts = [photometric_loss(image, Target(crop.pixels, valid=crop.compared))]
    photo = torch.from_numpy(crop.pixels).float().div_(255.0)
    error = (image.detach() - photo).abs().mean(dim=2) * torch.from_numpy(crop.compared)
    # The gradient of this with respect to the channel, which is zero, is the error in the pixels of each Gaussian.
    parts.append((raster.image[..., 3] * error).sum())
    means, quats, scales, opacities, sh = own
    alone = rasterize(
        means, quats, scales, opacities, sh=sh, camera=crop.camera, backend=backend, settings=settings
    )  # fmt: skip
    if crop.inside.any():
        target = Target(crop.pixels, valid=crop.inside)
        parts.append(ALONE_WEIGHT * photometric_loss(alone.image * gain, target))
    known = torch.from_numpy(crop.known)
    if crop.known.any():
        difference = 1 - alone.transmittance - torch.from_numpy(crop.alpha)
        parts.append(COVERAGE_WEIGHT * difference.abs()[known].mean())
        # Few pixels, from which the photometric loss would draw the object back: others explain them as well.
        kept = crop.shown & ~crop.inside
        if kept.any():
            parts.append(KEPT_WEIGHT * (-difference).clamp_min(0)[torch.from_numpy(kept)].mean())
    return sum(parts[1:], parts[0]), channel


def _tensors(parameters: Parameters) -> list[torch.Tensor]:
    values = parameters.values
    sh = torch.cat([values["sh_dc"], values["sh_rest"]], dim=1) if "sh_rest" in values else values["sh_dc"]
    return [values["means"], values["quats"], values["log_scales"].exp(), values["opacity_logits"].sigmoid(), sh]
