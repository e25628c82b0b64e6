"""One scene through both backends: float32 ``cpu`` against float64 ``reference``, forward and backward."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import torch

from ..rasterizer import CulledCounts, Raster
from .bounds import EPS32, FLIP, Bounds
from .condition import row_norms, sensitivities
from .scenes import NAMES, Scene
from .thresholds import hanging_pixels

__all__ = ["Finding", "GradientError", "Outcome", "Reason", "largest_error", "measure_scene", "worst_gradient"]

Outcome = Literal["bounded", "culled", "refused"]
Reason = Literal["near", "degenerate", "transparent", "outside"]

_UPSTREAM = ("by_image", "by_transmittance")


@dataclass(frozen=True)
class GradientError:
    """The Gaussian whose gradient is worst, in units of ``EPS32`` times its condition number.

    Attributes
    ----------
    ratio : float
        error / (EPS32 condition): what `Bounds.gradient` bounds.
    error : float
        |ours - truth| / |truth|, Euclidean norms of the Gaussian's row of the array.
    condition : float
        As `engine.stability.condition.sensitivities` defines it.
    array : str
        Name of the array.
    """

    ratio: float = 0.0
    error: float = 0.0
    condition: float = 0.0
    array: str = ""


@dataclass(frozen=True)
class Finding:
    """What one case came to.

    Attributes
    ----------
    outcome : {"bounded", "culled", "refused"}
    forward : float or None
        Largest error of the picture away from flips; None when the case has none.
    flips, near : int
        Pixels that decided a threshold otherwise than float64, and pixels that hang on one.
    gradient : GradientError or None
        None when the case has none.
    problems : tuple of str
        Everything that is out of bounds, as sentences.
    """

    outcome: Outcome
    forward: float | None = None
    flips: int = 0
    near: int = 0
    gradient: GradientError | None = None
    problems: tuple[str, ...] = ()


def measure_scene(
    scene: Scene, bounds: Bounds, *, suspects: slice | None = None, culled_as: Reason | None = None, seed: int = 5
) -> Finding:
    """Return how far the ``cpu`` backend is from float64 on this scene.

    The gradients are those of a random linear function (standard normal) of picture and transmittance that leaves out
    the pixels that hang on a threshold; these are judged by the picture alone.

    Parameters
    ----------
    scene : Scene
    bounds : Bounds
    suspects : slice, optional
        The Gaussians that the case is about: all of them must be drawn, or all be culled.
    culled_as : {"near", "degenerate", "transparent", "outside"}, optional
        The count in `CulledCounts` that must have exactly the suspects.
    seed : int
        Of the linear function.
    """
    blend_hangs, gradient_hangs = hanging_pixels(scene, bounds.near)
    upstream = _upstream(scene, gradient_hangs, seed)
    exact = {**scene.tensors(), **upstream}
    ours, our_gradients = _render_and_differentiate(scene, exact, torch.float32)
    truth, true_gradients = _render_and_differentiate(scene, exact, torch.float64)

    problems = _culling_problems(ours, truth, our_gradients, suspects, culled_as)
    forward, flips, flip_problems = _forward_error(scene, ours, truth, blend_hangs)
    problems += flip_problems
    if not forward <= bounds.forward:
        problems.append(f"the picture is wrong by {forward:.1e}, more than {bounds.forward:.0e}")
    near = int(gradient_hangs.sum())
    if near > bounds.near_share * gradient_hangs.numel():
        problems.append(f"{near} of {gradient_hangs.numel()} pixels hang on a threshold")
    moved = sensitivities(lambda arrays: _render_and_differentiate(scene, arrays, torch.float64)[1], exact)
    worst = worst_gradient(our_gradients, true_gradients, moved)
    if not worst.ratio <= bounds.gradient:
        problems.append(
            f"the gradient of {worst.array} is wrong by {worst.error:.1e}, {worst.ratio:.1e} times its rounding error"
        )
    drawn = suspects is None or bool(ours.visible[suspects].all())
    outcome: Outcome = "bounded" if drawn and culled_as is None else "culled"
    return Finding(outcome, forward, flips, near, worst, tuple(problems))


def largest_error(difference: torch.Tensor) -> float:
    """Return the largest absolute value, infinity when one is not a number, 0 of nothing."""
    if difference.numel() == 0:
        return 0.0
    return float(difference.abs().nan_to_num(nan=math.inf, posinf=math.inf).max())


def worst_gradient(
    ours: Mapping[str, torch.Tensor], truth: Mapping[str, torch.Tensor], moved: Mapping[str, torch.Tensor]
) -> GradientError:
    """Return the row of all arrays [N, ...] with the largest error in units of its rounding error.

    The condition is at least 1 (the result is stored in float32), and what is below the smallest normal float32 may be
    lost. A gradient that is zero however the inputs are rounded must be zero exactly.
    """
    worst = GradientError()
    tiny = float(torch.finfo(torch.float32).tiny)
    for name, gradient in ours.items():
        size = row_norms(truth[name])
        error = row_norms(gradient.double() - truth[name]).nan_to_num(nan=math.inf)
        scale = torch.maximum(moved[name], size)
        ratio = torch.where(error == 0, 0.0, error / (EPS32 * scale + tiny))
        if len(ratio) and float(ratio.max()) > worst.ratio:
            i = int(ratio.argmax())
            length = max(float(size[i]), tiny)
            worst = GradientError(float(ratio[i]), float(error[i]) / length, float(scale[i]) / length, name)
    return worst


def _upstream(scene: Scene, left_out: torch.Tensor, seed: int) -> dict[str, torch.Tensor]:
    """Return the gradients of the linear function with respect to picture and transmittance, float32 values."""
    generator = torch.Generator().manual_seed(seed)
    shape = (scene.camera.height, scene.camera.width)
    n_channels = 3 + scene.channels.shape[1]
    by_image = torch.randn(*shape, n_channels, generator=generator) * ~left_out[..., None]
    by_transmittance = torch.randn(*shape, generator=generator) * ~left_out
    return {"by_image": by_image.double(), "by_transmittance": by_transmittance.double()}


def _render_and_differentiate(
    scene: Scene, arrays: Mapping[str, torch.Tensor], dtype: torch.dtype
) -> tuple[Raster, dict[str, torch.Tensor]]:
    """Return the raster of `arrays` (float32: cpu, float64: reference) and the gradients of the linear function."""
    leaves = replace(scene, **{name: arrays[name] for name in NAMES}).cast(dtype)
    raster = leaves.render("cpu" if dtype == torch.float32 else "reference")
    if raster.image.requires_grad:  # nothing in front of the camera leaves the reference without a graph
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
    suspects: slice | None,
    culled_as: Reason | None,
) -> list[str]:
    """Return what is wrong with who is drawn: both backends agree, and who is not drawn has gradient zero."""
    problems = []
    if ours.culled != truth.culled or not torch.equal(ours.visible, truth.visible):
        problems.append(f"cpu culls {_told(ours.culled)}, float64 {_told(truth.culled)}")
    for name, gradient in our_gradients.items():
        if bool(gradient[~ours.visible].any()):
            problems.append(f"a culled Gaussian has a gradient of {name}")
    if suspects is not None:
        n, n_drawn = len(ours.visible[suspects]), int(ours.visible[suspects].sum())
        if 0 < n_drawn < n:
            problems.append(f"{n_drawn} of the {n} Gaussians in question are drawn, not all or none")
        if culled_as is not None and getattr(ours.culled, culled_as) != n:
            problems.append(f"{n} Gaussians should count as culled ({culled_as}), counted are {_told(ours.culled)}")
    return problems


def _told(culled: CulledCounts) -> str:
    counts = {"near": culled.near, "degenerate": culled.degenerate, "transparent": culled.transparent}
    return ", ".join(f"{reason} {count}" for reason, count in {**counts, "outside": culled.outside}.items())


def _forward_error(scene: Scene, ours: Raster, truth: Raster, hangs: torch.Tensor) -> tuple[float, int, list[str]]:
    """Return the largest error of picture and transmittance, the flips, and flips too large to be one.

    A pixel is a flip only if it hangs on a threshold in float64 and differs by more than rounding would explain.
    """
    drawn = truth.visible
    colors = 0.5 + row_norms(scene.sh[drawn].transpose(1, 2).reshape(-1, scene.sh.shape[1])).reshape(-1, 3)
    scale = max([1.0, largest_error(colors), largest_error(scene.channels[drawn])])
    by_image = (ours.image.double() - truth.image).abs().amax(dim=2) / scale
    error = torch.maximum(by_image, (ours.transmittance.double() - truth.transmittance).abs())
    error = error.nan_to_num(nan=math.inf)
    flipped = hangs & (error > 1e-6)
    problems = []
    if bool((error[flipped] > 2.0 * FLIP).any()):
        problems.append(f"a pixel at a threshold jumps by {float(error[flipped].max()):.1e}, no flip can")
    return largest_error(error[~flipped]), int(flipped.sum()), problems
