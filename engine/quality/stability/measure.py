"""Comparison of the float32 ``cpu`` backend with the float64 ``reference`` on one scene, forward and backward."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import torch

from ...rasterizer import CulledCounts, Raster
from .bounds import EPS32, FLIP, Bounds
from .condition import row_norms, sensitivities
from .scenes import NAMES, Scene
from .thresholds import pixels_near_thresholds

Outcome = Literal["bounded", "culled", "refused"]
Reason = Literal["near", "degenerate", "transparent", "outside"]

_UPSTREAM = ("by_image", "by_transmittance")


@dataclass(frozen=True)
class GradientError:
    """Error of the Gaussian with the worst gradient, in units of ``EPS32`` times its condition number.

    Attributes
    ----------
    ratio : float
        error / (EPS32 condition), which `Bounds.gradient` bounds.
    error : float
        |ours - truth| / |truth|, with Euclidean norms of the Gaussian's row of the array.
    condition : float
        Condition number as defined in `engine.quality.stability.condition.sensitivities`.
    array : str
        Name of the array.
    """

    ratio: float = 0.0
    error: float = 0.0
    condition: float = 0.0
    array: str = ""


@dataclass(frozen=True)
class Finding:
    """Result of one case.

    Attributes
    ----------
    outcome : {"bounded", "culled", "refused"}
    forward : float or None
        Largest error of the picture without the pixels that flipped; None if the case has no picture.
    flips, near : int
        Number of pixels that decided a threshold differently from float64, and of pixels near a threshold.
    gradient : GradientError or None
        None if the case has no gradient.
    problems : tuple of str
        Everything that is out of bounds, one clause each.
    """

    outcome: Outcome
    forward: float | None = None
    flips: int = 0
    near: int = 0
    gradient: GradientError | None = None
    problems: tuple[str, ...] = ()


def measure_scene(
    scene: Scene, bounds: Bounds, *, tested: slice | None = None, culled_as: Reason | None = None
) -> Finding:
    """Compare the ``cpu`` backend with float64 on this scene.

    The gradients are those of a random linear function (standard normal) of picture and transmittance without the
    pixels near a threshold, for which only the picture is compared.

    Parameters
    ----------
    tested : slice, optional
        The Gaussians under test: either all of them must be rendered, or all must be culled.
    culled_as : {"near", "degenerate", "transparent", "outside"}, optional
        The count in `CulledCounts` that must equal the number of Gaussians under test.
    """
    blend_near, gradient_near = pixels_near_thresholds(scene, bounds.near)
    upstream = _upstream(scene, gradient_near)
    exact = {**scene.tensors(), **upstream}
    ours, our_gradients = _render_and_differentiate(scene, exact, torch.float32)
    truth, true_gradients = _render_and_differentiate(scene, exact, torch.float64)

    problems = _culling_problems(ours, truth, our_gradients, tested, culled_as)
    forward, flips, flip_problems = _forward_error(scene, ours, truth, blend_near)
    problems += flip_problems
    if not forward <= bounds.forward:
        problems.append(f"the picture is wrong by {forward:.1e}, more than {bounds.forward:.0e}")
    near = int(gradient_near.sum())
    if near > bounds.near_share * gradient_near.numel():
        problems.append(f"{near} of {gradient_near.numel()} pixels are near a threshold")
    sensitivity = sensitivities(lambda arrays: _render_and_differentiate(scene, arrays, torch.float64)[1], exact)
    worst = worst_gradient(our_gradients, true_gradients, sensitivity)
    if not worst.ratio <= bounds.gradient:
        problems.append(
            f"the gradient of {worst.array} is wrong by {worst.error:.1e}, {worst.ratio:.1e} times its rounding error"
        )
    drawn = tested is None or bool(ours.visible[tested].all())
    outcome: Outcome = "bounded" if drawn and culled_as is None else "culled"
    return Finding(outcome, forward, flips, near, worst, tuple(problems))


def largest_error(difference: torch.Tensor) -> float:
    """Return the largest absolute value: infinity if one is NaN, 0 for an empty tensor."""
    if difference.numel() == 0:
        return 0.0
    return float(difference.abs().nan_to_num(nan=math.inf, posinf=math.inf).max())


def worst_gradient(
    ours: Mapping[str, torch.Tensor], truth: Mapping[str, torch.Tensor], sensitivity: Mapping[str, torch.Tensor]
) -> GradientError:
    """Return the error of the row, of all arrays [N, ...], that is largest in units of its rounding error.

    The condition is at least 1, because the result is stored in float32. Values below the smallest normal float32 may
    be lost. A gradient that is zero for all roundings of the inputs must be exactly zero.

    Parameters
    ----------
    ours, truth : mapping of str to tensor
        Gradients in float32 and in float64.
    sensitivity : mapping of str to tensor
        Result of `sensitivities` for the same arrays.
    """
    worst = GradientError()
    tiny = float(torch.finfo(torch.float32).tiny)
    for name, gradient in ours.items():
        size = row_norms(truth[name])
        error = row_norms(gradient.double() - truth[name]).nan_to_num(nan=math.inf)
        scale = torch.maximum(sensitivity[name], size)
        ratio = torch.where(error == 0, 0.0, error / (EPS32 * scale + tiny))
        if len(ratio) and float(ratio.max()) > worst.ratio:
            i = int(ratio.argmax())
            length = max(float(size[i]), tiny)
            worst = GradientError(float(ratio[i]), float(error[i]) / length, float(scale[i]) / length, name)
    return worst


def _upstream(scene: Scene, excluded: torch.Tensor) -> dict[str, torch.Tensor]:
    """Return the coefficients of the linear function for picture and transmittance, float32 values, 0 if `excluded`."""
    generator = torch.Generator().manual_seed(5)
    shape = (scene.camera.height, scene.camera.width)
    n_channels = 3 + scene.channels.shape[1]
    by_image = torch.randn(*shape, n_channels, generator=generator) * ~excluded[..., None]
    by_transmittance = torch.randn(*shape, generator=generator) * ~excluded
    return {"by_image": by_image.double(), "by_transmittance": by_transmittance.double()}


def _render_and_differentiate(
    scene: Scene, arrays: Mapping[str, torch.Tensor], dtype: torch.dtype
) -> tuple[Raster, dict[str, torch.Tensor]]:
    """Return the raster of `arrays` (float32: cpu, float64: reference) and the gradients of the linear function."""
    leaves = replace(scene, **{name: arrays[name] for name in NAMES}).cast(dtype)
    raster = leaves.render("cpu" if dtype == torch.float32 else "reference")
    if raster.image.requires_grad:  # false if no Gaussian is in front of the camera: the reference then has no graph
        torch.autograd.backward(
            [raster.image, raster.transmittance][: 2 if raster.transmittance.requires_grad else 1],
            [arrays[name].to(dtype) for name in _UPSTREAM][: 2 if raster.transmittance.requires_grad else 1],
        )
    gradients = {
        name: torch.zeros_like(value) if value.grad is None else value.grad for name, value in leaves.tensors().items()
    }
    return replace(raster, image=raster.image.detach(), transmittance=raster.transmittance.detach()), gradients


def _culling_problems(
    ours: Raster,
    truth: Raster,
    our_gradients: Mapping[str, torch.Tensor],
    tested: slice | None,
    culled_as: Reason | None,
) -> list[str]:
    """Check that both backends cull the same Gaussians and that culled Gaussians have gradient zero."""
    problems = []
    if ours.culled != truth.culled or not torch.equal(ours.visible, truth.visible):
        problems.append(f"cpu culls {_format_counts(ours.culled)}; float64 culls {_format_counts(truth.culled)}")
    for name, gradient in our_gradients.items():
        if bool(gradient[~ours.visible].any()):
            problems.append(f"a culled Gaussian has a gradient of {name}")
    if tested is not None:
        n, n_drawn = len(ours.visible[tested]), int(ours.visible[tested].sum())
        if 0 < n_drawn < n:
            problems.append(f"{n_drawn} of the {n} Gaussians under test are rendered, not all or none")
        if culled_as is not None and getattr(ours.culled, culled_as) != n:
            problems.append(
                f"{n} Gaussians must be counted as culled ({culled_as}); the counts are {_format_counts(ours.culled)}"
            )
    return problems


def _format_counts(culled: CulledCounts) -> str:
    counts = {"near": culled.near, "degenerate": culled.degenerate, "transparent": culled.transparent}
    return ", ".join(f"{reason} {count}" for reason, count in {**counts, "outside": culled.outside}.items())


def _forward_error(scene: Scene, ours: Raster, truth: Raster, near: torch.Tensor) -> tuple[float, int, list[str]]:
    """Return the largest error of picture and transmittance, the number of flips, and problems with flips.

    A pixel flips if it is near a threshold in float64 and its error is larger than rounding explains. The error of a
    flip has an upper limit.
    """
    drawn = truth.visible
    colors = 0.5 + row_norms(scene.sh[drawn].transpose(1, 2).reshape(-1, scene.sh.shape[1])).reshape(-1, 3)
    scale = max([1.0, largest_error(colors), largest_error(scene.channels[drawn])])
    by_image = (ours.image.double() - truth.image).abs().amax(dim=2) / scale
    error = torch.maximum(by_image, (ours.transmittance.double() - truth.transmittance).abs())
    error = error.nan_to_num(nan=math.inf)
    flipped = near & (error > 1e-6)
    problems = []
    if bool((error[flipped] > 2.0 * FLIP).any()):
        problems.append(
            f"a pixel near a threshold is wrong by {float(error[flipped].max()):.1e}, more than a flip can cause"
        )
    return largest_error(error[~flipped]), int(flipped.sum()), problems
