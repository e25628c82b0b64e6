"""Rules that hold exactly, not within a bound: thresholds, clamping, order of the arrays, and refused input."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import torch

from ...core.errors import CameraError, NumericalError
from ...rasterizer import Raster
from ...rasterizer.settings import ALPHA_MAX, ALPHA_MIN, T_MIN, Backend
from .bounds import Bounds
from .measure import Finding, largest_error
from .scenes import Scene, facing_camera, ordinary_scene

BAD_VALUES = (math.nan, math.inf, -math.inf)
BACKENDS: tuple[Backend, ...] = ("cpu", "reference")
DTYPES = {"cpu": torch.float32, "reference": torch.float64}


def stack_on_one_pixel(opacities: np.ndarray, offsets: np.ndarray | None = None) -> Scene:
    """Return Gaussians one behind the other in a picture of one pixel, each with its own channel.

    `opacities` [n] and the lateral `offsets` [n] in world units are rounded to float32. Without an offset, the alpha of
    a Gaussian on the pixel is its opacity (the kernels' exponential of 0 is 1 within 3e-7). Channel i of the picture is
    the weight alpha_i T_i of Gaussian i.
    """
    n = len(opacities)
    means = np.zeros((n, 3))
    means[:, 2] = 2.0 + 0.01 * np.arange(n)
    if offsets is not None:
        means[:, 0] = offsets
    template = ordinary_scene(n, camera=facing_camera(1, 1))
    quats = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    dark = torch.zeros_like(template.sh[:, :1])
    return replace(template, sh=dark).with_arrays(
        means=means, quats=quats, scales=np.full((n, 3), 0.1), opacities=opacities, channels=np.eye(n)
    )


def threshold_stacks() -> list[Scene]:
    """Return stacks whose alphas or transmittances are on both sides of each threshold, some one float32 step away."""
    steps = np.arange(-20, 21)
    far = 1.0 + np.linspace(-0.2, 0.2, 41)
    alpha_min, alpha_max = np.float32(ALPHA_MIN), np.float32(ALPHA_MAX)
    # At this offset alpha is ALPHA_MIN (2 = depth, 50 = focal length, 0.3 = low-pass filter).
    variance = (50.0 * 0.1 / 2.0) ** 2 + 0.3
    offset = math.sqrt(2.0 * variance * math.log(0.5 / ALPHA_MIN)) * 2.0 / 50.0
    stacks = [
        stack_on_one_pixel(alpha_min + steps * np.spacing(alpha_min)),
        stack_on_one_pixel(alpha_min * far),
        stack_on_one_pixel(np.full(41, 0.5), offset * (1.0 + steps * 1e-7)),
        stack_on_one_pixel(np.full(41, 0.5), offset * (1.0 + (far - 1.0) * 0.1)),
    ]
    for front in (0.5, 0.9, 0.985):
        # Behind `front`, an alpha of 1 - T_MIN / (1 - front) reaches the cut-off exactly.
        last = np.float32(1.0 - T_MIN / (1.0 - front))
        if last < alpha_max:
            stacks += [stack_on_one_pixel(np.array([front, x, 0.3])) for x in last + steps * np.spacing(last)]
    stacks += [stack_on_one_pixel(np.array([x, 0.99, 0.3])) for x in alpha_max + steps * np.spacing(alpha_max)]
    stacks += [stack_on_one_pixel(np.full(8, x)) for x in (0.5, 0.9, 0.985, 0.99, 1.0)]
    return stacks


def passes_agree(bounds: Bounds) -> Finding:
    """Check that forward and backward pass of ``cpu`` decide every threshold identically.

    The weight of a Gaussian is read twice: from its own channel in the picture, and as the gradient of that channel's
    value. Both must be the same float32 number, and a Gaussian with weight zero must have no gradient at all.
    """
    problems: list[str] = []
    worst = 0.0
    for stack in threshold_stacks():
        leaves = stack.cast(torch.float32)
        image = leaves.render("cpu").image
        # Products with powers of two are exact, and with them the gradients of opacities do not cancel to zero.
        upstream = 2.0 ** (torch.arange(image.shape[2]) % 3)
        (image * upstream).sum().backward()
        gradients = leaves.tensors()
        assert leaves.channels.grad is not None and leaves.opacities.grad is not None
        forward = image.detach()[0, 0, 3:]
        backward = leaves.channels.grad.diagonal() / upstream[3:]
        worst = max(worst, largest_error(forward - backward))
        n_differ = int((forward != backward).sum())
        if n_differ:
            problems.append(f"the passes give {n_differ} of {len(forward)} Gaussians different weights")
        unseen = forward == 0
        for name, leaf in gradients.items():
            if leaf.grad is not None and bool(leaf.grad[unseen].any()):
                problems.append(f"a Gaussian with weight zero has a gradient of {name}")
        unclamped = stack.opacities < ALPHA_MAX * (1.0 - 1e-6)
        if stack.means[:, 0].any():
            continue  # off the pixel, alpha is less than the opacity
        if bool((leaves.opacities.grad[~unseen & unclamped] == 0).any()):
            problems.append("a visible Gaussian that is not clamped has no gradient of opacities")
    return Finding("bounded", forward=worst, problems=tuple(dict.fromkeys(problems)))


def clamp_has_no_gradient(bounds: Bounds) -> Finding:
    """Check that in both backends an alpha above the clamp has a gradient of exactly zero, and one below it has not."""
    problems = []
    geometry = ("means", "quats", "scales", "opacities")
    cases = ((0.985, False), (0.99 - 1e-6, False), (0.99 + 1e-6, True), (0.995, True), (1.0, True))
    for opacity, clamped in cases:
        # 1e-4 standard deviations off the centre of the pixel, so that the mean has a gradient.
        stack = stack_on_one_pixel(np.array([opacity, 0.4]), np.array([1e-5, 0.0]))
        for backend in BACKENDS:
            leaves = stack.cast(DTYPES[backend])
            leaves.render(backend).image.sum().backward()
            for name in geometry:
                gradient = leaves.tensors()[name].grad
                assert gradient is not None
                zero = not bool(gradient[0].any())
                if clamped and not zero:
                    problems.append(f"{backend}: alpha {opacity} is clamped and has a gradient of {name}")
                if not clamped and zero and name == "opacities":
                    problems.append(f"{backend}: alpha {opacity} is not clamped and has no gradient of {name}")
    return Finding("bounded", problems=tuple(problems))


def array_order_does_not_matter(bounds: Bounds) -> Finding:
    """Check that a shuffled scene of different depths has exactly the same picture and gradients."""
    scene = ordinary_scene(40)
    order = torch.randperm(40, generator=torch.Generator().manual_seed(3))
    plain, shuffled = scene.cast(torch.float32), scene.rows(order).cast(torch.float32)
    pictures = []
    for leaves in (plain, shuffled):
        raster = leaves.render("cpu")
        (raster.image.square().sum() + raster.transmittance.sum()).backward()
        pictures.append(raster.image.detach())
    problems = [] if torch.equal(*pictures) else ["the picture depends on the order of the arrays"]
    for name, leaf in plain.tensors().items():
        shuffled_gradient = shuffled.tensors()[name].grad
        assert leaf.grad is not None and shuffled_gradient is not None
        if not torch.equal(leaf.grad[order], shuffled_gradient):
            problems.append(f"the gradient of {name} depends on the order of the arrays")
    return Finding("bounded", forward=largest_error(pictures[0] - pictures[1]), problems=tuple(problems))


def refuses_input(name: str) -> Callable[[Bounds], Finding]:
    """Return a case: both backends refuse NaN and infinities in the array `name` with an error that names the array."""

    def run(bounds: Bounds) -> Finding:
        problems = []
        for bad in BAD_VALUES:
            scene = ordinary_scene(5)
            values = scene.tensors()[name].clone()
            values.reshape(5, -1)[3, 0] = bad
            broken = replace(scene, **{name: values})
            for backend in BACKENDS:
                problems += _refusal_problems(
                    partial(_render, broken, backend),
                    NumericalError,
                    f"`{name}`",
                    f"{backend} with {bad}",
                )
        return _refusal_finding(problems)

    return run


def refuses_bad_gradient(bounds: Bounds) -> Finding:
    """Check that the backward pass refuses an incoming gradient that is not finite."""
    problems = []
    for bad in BAD_VALUES:
        image = ordinary_scene(5).cast(torch.float32).render("cpu").image
        upstream = torch.zeros_like(image)
        upstream[-1, -1, -1] = bad
        problems += _refusal_problems(partial(image.backward, upstream), NumericalError, "gradient", f"{bad}")
    return _refusal_finding(problems)


def refuses_bad_camera(bounds: Bounds) -> Finding:
    """Check that a camera whose pose or intrinsics are not finite is refused."""
    problems = []
    for bad in BAD_VALUES:
        for name in ("viewmat", "K"):
            camera = facing_camera()
            getattr(camera, name)[0, 2] = bad
            scene = ordinary_scene(5, camera=camera)
            problems += _refusal_problems(partial(_render, scene, "cpu"), CameraError, "finite", f"{name} with {bad}")
    return _refusal_finding(problems)


def _render(scene: Scene, backend: Backend) -> Raster:
    return scene.cast(DTYPES[backend]).render(backend)


def _refusal_problems(compute: Callable[[], object], error: type[Exception], word: str, what: str) -> list[str]:
    """Return the problem if `compute` does not raise `error` with `word` in its message, else nothing."""
    try:
        compute()
    except error as refusal:
        return [] if word in str(refusal) else [f"{what} is refused without naming {word}: {refusal}"]
    return [f"{what} is not refused"]


def _refusal_finding(problems: list[str]) -> Finding:
    return Finding("refused", problems=tuple(problems))
