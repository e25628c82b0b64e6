"""Training of some Gaussians of a scene on parts of its photos at the photos' own resolution, the others frozen.

See `engine.objects.detail`, which cuts the parts out of the photos.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch

from ..core.arrays import Float32, Mask, Pixels
from ..core.errors import Cancelled
from ..core.events import StopCheck
from ..rasterizer import rasterize
from ..rasterizer.settings import Backend, RasterSettings
from ..scene import Gaussians, PinholeCamera
from .densify import split
from .guards import backward, step_finite_rows
from .losses import Target, photometric_loss
from .parameters import Parameters

__all__ = ["DetailCrop", "DetailPlan", "detail_psnr", "train_detail"]

_WINDOW_PIXELS = 160 * 160
"""Pixels of a crop that a step compares: the whole crop, reduced, or a window of it. It bounds the time of a step."""

_COARSE = 0.25  # chosen on museum_room
"""Share of the steps, the first ones, that compare whole crops, in which far displacements are seen."""

_COVERAGE_WEIGHT = 0.3  # chosen on museum_room
"""Weight of the coverage's L1 distance relative to the photometric loss."""

_KEPT_WEIGHT = 1.0  # chosen on museum_room
"""Weight of the coverage that is missing where the object keeps what others show as well."""

_ALONE_WEIGHT = 1.0  # chosen on museum_room
"""Weight of the photometric loss of the object alone, inside of its outline, relative to that within the scene."""

_LEARNING_RATES = {
    "means": 0.03,  # in units of the Gaussians' median scale
    "log_scales": 0.01,
    "quats": 0.003,
    "opacity_logits": 0.05,
    "sh_dc": 0.006,
    "sh_rest": 0.001,
}  # chosen on museum_room
"""Learning rates of the first step."""

_FINAL_RATE_FACTOR = 0.1  # chosen on museum_room
"""Learning rate at the end, relative to the first step. The rates fall exponentially."""

_N_GROWTHS = 6
"""How often Gaussians are split."""

_GROW_UNTIL = 0.6  # chosen on museum_room
"""Share of the steps after which none is split any more."""

_MAX_NEEDLE = 4.0
"""Largest ratio of the longest to the middle scale of a Gaussian: longer ones are seen as straw."""

_MAX_FLAT = 50.0
"""Largest ratio of the middle to the shortest scale: a surface is flat."""

_MAX_SCALE = 0.2  # chosen on museum_room
"""Largest scale of a Gaussian, in the radius of the object."""

_BOX_MARGIN = 0.03
"""Distance that a centre may leave the box of the object's Gaussians, as a share of the radius."""

_REACH = 3.0
"""Standard deviations beyond which a Gaussian does not reach into a window."""

_NEAREST = 0.01
"""Smallest depth at which a Gaussian may be in a window, world units."""


@dataclass(frozen=True)
class DetailCrop:
    """The part of a photo that shows an object, [h, w].

    Attributes
    ----------
    photo : str
        Name of the photo.
    camera : PinholeCamera
        Camera of the part.
    pixels : array of shape [h, w, 3], uint8
    compared : array of shape [h, w], bool
        Valid pixels to which the object contributes, and a margin.
    inside : array of shape [h, w], bool
        Valid pixels that the object alone must show as the photo does.
    shown : array of shape [h, w], bool
        Valid pixels in which the object alone is compared with the photo, `inside` among them.
    alpha : array of shape [h, w], float32
        Coverage that the object has alone.
    known : array of shape [h, w], bool
        Where `alpha` is known: nothing hides the object.
    gain : array of shape [3], float32
        Brightness of the photo relative to the scene.
    weight : float
        How often the photo is used, relative to others.
    """

    photo: str
    camera: PinholeCamera
    pixels: Pixels
    compared: Mask
    inside: Mask
    shown: Mask
    alpha: Float32
    known: Mask
    gain: Float32
    weight: float

    def window(self, left: int, top: int, width: int, height: int) -> DetailCrop:
        """Return a part of the crop."""
        rows, columns = slice(top, top + height), slice(left, left + width)
        K = self.camera.K - np.array([[0, 0, left], [0, 0, top], [0, 0, 0]])
        arrays = {name: getattr(self, name)[rows, columns] for name in _PICTURES}
        return replace(self, **arrays, camera=replace(self.camera, K=K, width=width, height=height))

    def reduced(self, max_pixels: int) -> DetailCrop:
        """Return the crop with at most `max_pixels`, rounded."""
        height, width = self.alpha.shape
        scale = math.sqrt(max_pixels / (width * height))
        if scale >= 1:
            return self
        size = (max(8, round(width * scale)), max(8, round(height * scale)))
        factors = np.array([size[0] / width, size[1] / height, 1.0])
        arrays = {}
        for name in _PICTURES:
            values = getattr(self, name)
            kind = np.float32 if values.dtype == bool else values.dtype
            smaller = cv2.resize(values.astype(kind), size, interpolation=cv2.INTER_AREA)
            # All pixels that are averaged have to be inside, or known.
            arrays[name] = smaller > 0.999 if values.dtype == bool else smaller
        K = self.camera.K * factors[:, None]
        return replace(self, **arrays, camera=replace(self.camera, K=K, width=size[0], height=size[1]))


_PICTURES = ("pixels", "compared", "inside", "shown", "alpha", "known")


@dataclass(frozen=True)
class DetailPlan:
    """How much is trained.

    Attributes
    ----------
    steps : int
    max_gaussians : int
        Gaussians of the object at the end at most.
    """

    steps: int
    max_gaussians: int


class _Frozen:
    """Gaussians that are drawn and not trained."""

    def __init__(self, gaussians: Gaussians) -> None:
        self.means = gaussians.means
        self.reach = _REACH * np.exp(gaussians.log_scales).max(axis=1)
        self.tensors = [
            torch.from_numpy(np.ascontiguousarray(values))
            for values in (gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities, gaussians.sh)
        ]

    def in_window(self, camera: PinholeCamera) -> list[torch.Tensor]:
        """Return means, quats, scales, opacities and sh of those that may reach into the picture of `camera`."""
        local = self.means @ camera.viewmat[:3, :3].T.astype(np.float32) + camera.viewmat[:3, 3].astype(np.float32)
        depth = np.maximum(local[:, 2], _NEAREST)
        radius = self.reach / depth * np.float32(camera.K[0, 0])
        x, y = (local[:, axis] / depth * camera.K[axis, axis] + camera.K[axis, 2] for axis in (0, 1))
        near = (x > -radius) & (x < camera.width + radius) & (y > -radius) & (y < camera.height + radius)
        rows = torch.from_numpy(np.flatnonzero(near & (local[:, 2] > -self.reach)))
        return [values[rows] for values in self.tensors]


def train_detail(
    gaussians: Gaussians,
    others: Gaussians,
    crops: Sequence[DetailCrop],
    plan: DetailPlan,
    *,
    backend: Backend,
    should_stop: StopCheck,
    tell: Callable[[float, float | None], None],
) -> tuple[Gaussians, np.ndarray]:
    """Return Gaussians that look more like the photos, in the scene and alone.

    Parameters
    ----------
    gaussians : Gaussians
        M of the object, without features.
    others : Gaussians
        The rest of the scene, which is drawn with them and stays as it is.
    crops : sequence of DetailCrop
        At least one.
    plan : DetailPlan
    backend : {"cpu", "reference"}
    should_stop : callable
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

    Notes
    -----
    A step compares a window of one photo. The loss is the photometric loss of the whole scene where the object
    contributes, times the photo's brightness; that of the object alone inside of its outline; and the L1 distance of
    the coverage that it has alone.
    """
    parameters = Parameters.from_gaussians(gaussians, sh_degree=gaussians.sh_degree, features=False)
    names = list(parameters.values)
    # Copies and halves of a Gaussian inherit all of its values, so also its number. float32 counts to 2^24.
    numbers = Parameters.from_gaussians(gaussians, sh_degree=0, features=False).values["opacity_logits"]
    parameters.values["parent"] = torch.arange(len(numbers), dtype=torch.float32)
    parameters.moments["parent"] = type(parameters.moments["means"]).zeros_like(parameters.values["parent"])
    frozen, settings = _Frozen(others), RasterSettings(antialiased=gaussians.antialiased)
    limits = _Limits.of(gaussians)
    random, generator = np.random.default_rng(0), torch.Generator().manual_seed(0)
    coarse = [crop.reduced(_WINDOW_PIXELS) for crop in crops]
    weights = np.array([crop.weight for crop in crops])
    weights = weights / weights.sum()
    grow_at = {round(plan.steps * _GROW_UNTIL * (i + 1) / (_N_GROWTHS + 1)): i + 1 for i in range(_N_GROWTHS)}
    errors, guards = torch.zeros(len(parameters)), Counter[str]()
    started = time.monotonic()
    for step in range(plan.steps):
        if should_stop():
            raise Cancelled("Stopped while detailing; nothing was stored.")
        if step % 20 == 0:
            done = step / plan.steps
            tell(done, (time.monotonic() - started) * (1 - done) / done if step else None)
        index = int(random.choice(len(crops), p=weights))
        crop = coarse[index] if step < _COARSE * plan.steps else _random_window(crops[index], random)
        parameters.track()
        loss, error = _step_loss(parameters, frozen.in_window(crop.camera), crop, backend, settings)
        if loss is None:
            continue
        if backward(loss, guards):
            assert error.grad is not None
            errors += error.grad[: len(parameters), 0]
            factor = _FINAL_RATE_FACTOR ** (step / plan.steps)
            scale = float(parameters.values["log_scales"].detach().median().exp())
            rates = {name: factor * _LEARNING_RATES[name] for name in names}
            rates["means"] *= scale
            step_finite_rows(parameters, lambda rates=rates: parameters.step(rates), guards)  # type: ignore[misc]
            limits.apply(parameters)
        if step in grow_at:
            left = plan.max_gaussians - len(parameters)
            n_new = math.ceil(left / (_N_GROWTHS + 1 - grow_at[step]))
            split(parameters, errors, max(0, n_new), generator=generator)
            errors = torch.zeros(len(parameters))
    parents = parameters.values.pop("parent").detach().numpy().astype(np.int64)
    trained = parameters.to_gaussians(unit_features=False)
    return replace(trained, antialiased=gaussians.antialiased), parents


def _step_loss(
    parameters: Parameters, others: list[torch.Tensor], crop: DetailCrop, backend: Backend, settings: RasterSettings
) -> tuple[torch.Tensor | None, torch.Tensor]:
    """Return the loss, None where the crop shows nothing, and a channel whose gradient is the error of each."""
    own = _tensors(parameters)
    joined = [torch.cat(pair) for pair in zip(own, others, strict=True)]
    means, quats, scales, opacities, sh = joined
    channel = torch.zeros(len(means), 1, requires_grad=True)
    gain = torch.from_numpy(crop.gain)
    parts = []
    if crop.compared.any():
        raster = rasterize(
            means, quats, scales, opacities, sh=sh, camera=crop.camera, channels=channel, detached_channels=True,
            backend=backend, settings=settings,
        )  # fmt: skip
        image = raster.image[..., :3] * gain
        parts.append(photometric_loss(image, Target(crop.pixels, valid=crop.compared)))
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
        parts.append(_ALONE_WEIGHT * photometric_loss(alone.image * gain, target))
    known = torch.from_numpy(crop.known)
    if crop.known.any():
        difference = 1 - alone.transmittance - torch.from_numpy(crop.alpha)
        parts.append(_COVERAGE_WEIGHT * difference.abs()[known].mean())
        # Few pixels, from which the photometric loss would draw the object back: others explain them as well.
        kept = crop.shown & ~crop.inside
        if kept.any():
            parts.append(_KEPT_WEIGHT * (-difference).clamp_min(0)[torch.from_numpy(kept)].mean())
    return (sum(parts[1:], parts[0]) if crop.compared.any() else None), channel


def _tensors(parameters: Parameters) -> list[torch.Tensor]:
    values = parameters.values
    sh = torch.cat([values["sh_dc"], values["sh_rest"]], dim=1) if "sh_rest" in values else values["sh_dc"]
    return [values["means"], values["quats"], values["log_scales"].exp(), values["opacity_logits"].sigmoid(), sh]


def _random_window(crop: DetailCrop, random: np.random.Generator) -> DetailCrop:
    """Return a window of at most `_WINDOW_PIXELS` around a random pixel to which the object contributes."""
    height, width = crop.alpha.shape
    if width * height <= _WINDOW_PIXELS or not crop.compared.any():
        return crop
    side = math.sqrt(_WINDOW_PIXELS)
    w = min(width, round(max(side, _WINDOW_PIXELS / height)))
    h = min(height, round(max(side, _WINDOW_PIXELS / width)))
    chosen = np.flatnonzero(crop.compared)[random.integers(int(crop.compared.sum()))]
    y, x = divmod(int(chosen), width)
    return crop.window(min(max(0, x - w // 2), width - w), min(max(0, y - h // 2), height - h), w, h)


@dataclass(frozen=True)
class _Limits:
    """What no Gaussian of an object may exceed: a box for its centre, and the largest logarithm of its scales."""

    low: torch.Tensor
    high: torch.Tensor
    log_scale: float

    @classmethod
    def of(cls, gaussians: Gaussians) -> _Limits:
        low, high = gaussians.means.min(axis=0), gaussians.means.max(axis=0)
        inner = np.quantile(gaussians.means, (0.05, 0.95), axis=0)
        radius = max(float(np.linalg.norm(inner[1] - inner[0])) / 2, 1e-6)
        margin = np.float32(_BOX_MARGIN * radius)
        return cls(torch.from_numpy(low - margin), torch.from_numpy(high + margin), math.log(_MAX_SCALE * radius))

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
        values["opacity_logits"].clamp_(-8.0, 8.0)
        values["quats"].div_(values["quats"].norm(dim=1, keepdim=True).clamp_min(1e-6))


def detail_psnr(gaussians: Gaussians, crops: Sequence[DetailCrop], *, backend: Backend) -> float:
    """Return the PSNR in dB of Gaussians alone over black, where `crops` show them."""
    parameters = Parameters.from_gaussians(gaussians, sh_degree=gaussians.sh_degree, features=False)
    settings = RasterSettings(antialiased=gaussians.antialiased)
    total, count = 0.0, 0
    with torch.no_grad():
        means, quats, scales, opacities, sh = _tensors(parameters)
        for crop in crops:
            image = rasterize(
                means, quats, scales, opacities, sh=sh, camera=crop.camera, backend=backend, settings=settings
            ).image.numpy()  # fmt: skip
            difference = np.clip(image * crop.gain, 0, 1) - crop.pixels / np.float32(255)
            total += float(np.square(difference[crop.shown], dtype=np.float64).sum())
            count += 3 * int(crop.shown.sum())
    return -10.0 * math.log10(max(total / max(count, 1), 1e-10))
