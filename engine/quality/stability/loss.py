"""`photometric_loss` in float32 compared with SSIM and L1 in float64, written as convolutions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import torch
import torch.nn.functional as functional

from ...core.errors import NumericalError
from ...training import photometric_loss
from .bounds import Bounds
from .condition import sensitivities
from .measure import Finding, worst_gradient

Pair = tuple[torch.Tensor, torch.Tensor]
SIZE = (27, 35)
_LAMBDA = 0.2


def _noise(seed: int) -> torch.Tensor:
    return torch.rand(*SIZE, 3, generator=torch.Generator().manual_seed(seed))


def _flat(value: float) -> torch.Tensor:
    return torch.full((*SIZE, 3), value)


PICTURES: dict[str, tuple[str, Callable[[], Pair]]] = {
    "loss_noise": ("two pictures of noise", lambda: (_noise(0), _noise(1))),
    "loss_constant": ("constant gray 0.4 against gray 0.5", lambda: (_flat(0.4), _flat(0.5))),
    "loss_equal": ("a picture against itself", lambda: (_noise(0), _noise(0))),
    "loss_black": ("black against black", lambda: (_flat(0.0), _flat(0.0))),
    "loss_black_photo": ("noise against a black photo", lambda: (_noise(0), _flat(0.0))),
    "loss_saturated": ("white against nearly white", lambda: (_flat(1.0), 1.0 - 0.01 * _noise(1))),
    "loss_huge": ("noise of size 1e4 against a photo", lambda: (1e4 * _noise(0), _noise(1))),
    "loss_huge_constant": ("constant 1e4 against a photo", lambda: (_flat(1e4), _noise(1))),
}
"""Cases by name: a description, and a function that returns rendered picture and photo, float32 [H, W, 3]."""


def exact_loss(image: torch.Tensor, target: torch.Tensor, lambda_dssim: float) -> torch.Tensor:
    """Return (1 - lambda) mean |x - y| + lambda (1 - mean SSIM) of float64 pictures [H, W, 3].

    Variances are weighted squares around each pixel's weighted mean a, sum_k w_k (x_k - a)^2 over the window (zeros
    outside of the picture), so nothing cancels for large values. Wang et al. 2004, 11x11 window, sigma 1.5.
    """
    offsets = torch.arange(11, dtype=torch.float64) - 5.0
    window = torch.exp(-(offsets**2) / (2.0 * 1.5**2))
    weights = torch.outer(window / window.sum(), window / window.sum()).reshape(-1, 1)

    def windows(picture: torch.Tensor) -> torch.Tensor:
        unfolded = functional.unfold(picture.permute(2, 0, 1)[:, None], 11, padding=5)
        return unfolded  # [3, 121, H W]

    x, y = windows(image), windows(target)
    a, b = (x * weights).sum(dim=1, keepdim=True), (y * weights).sum(dim=1, keepdim=True)
    xx = (weights * (x - a) ** 2).sum(dim=1)
    yy = (weights * (y - b) ** 2).sum(dim=1)
    xy = (weights * (x - a) * (y - b)).sum(dim=1)
    a, b = a[:, 0], b[:, 0]
    c1, c2 = 0.01**2, 0.03**2
    ssim = (2 * a * b + c1) * (2 * xy + c2) / ((a * a + b * b + c1) * (xx + yy + c2))
    return (1.0 - lambda_dssim) * (image - target).abs().mean() + lambda_dssim * (1.0 - ssim.mean())


def compares_pictures(make: Callable[[], Pair]) -> Callable[[Bounds], Finding]:
    """Return a case that compares value and gradient of the loss of two pictures with float64.

    The value is that of training (lambda 0.2); its error is relative if the value is above 1. The gradient is that of
    1 - SSIM per pixel. The gradient of L1 is a sign and is tested exactly elsewhere.
    """

    def run(bounds: Bounds) -> Finding:
        image, target = make()
        problems = []
        truth = float(exact_loss(image.double(), target.double(), _LAMBDA))
        ours = float(photometric_loss(image, target, lambda_dssim=_LAMBDA, threads=1))
        forward = abs(ours - truth) / max(1.0, abs(truth))
        forward = math.inf if math.isnan(forward) else forward
        if not forward <= bounds.forward:
            problems.append(f"the loss is {ours:.6g}, in float64 {truth:.6g}")
        by_l1 = _gradient_of(image, target, 0.0)
        if not torch.equal(by_l1, torch.sign(image - target) * torch.tensor(1.0 / image.numel())):
            problems.append("the gradient of L1 is not its sign over the number of values")

        def exact_gradient(arrays: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
            leaf = arrays["image"].reshape(image.shape).clone().requires_grad_()
            exact_loss(leaf, arrays["target"].reshape(image.shape), 1.0).backward()
            assert leaf.grad is not None
            return {"image": leaf.grad.reshape(-1, 3)}

        exact = {"image": image.double().reshape(-1, 3), "target": target.double().reshape(-1, 3)}
        moved = sensitivities(exact_gradient, exact)
        found = {"image": _gradient_of(image, target, 1.0).reshape(-1, 3)}
        worst = worst_gradient(found, exact_gradient(exact), moved)
        if not worst.ratio <= bounds.gradient:
            problems.append(f"the gradient of 1 - SSIM is wrong by {worst.error:.1e}, {worst.ratio:.1e} roundings")
        return Finding("bounded", forward=forward, gradient=worst, problems=tuple(problems))

    return run


def _gradient_of(image: torch.Tensor, target: torch.Tensor, lambda_dssim: float) -> torch.Tensor:
    leaf = image.clone().requires_grad_()
    photometric_loss(leaf, target, lambda_dssim=lambda_dssim, threads=1).backward()
    assert leaf.grad is not None
    return leaf.grad


def refuses_picture(bounds: Bounds) -> Finding:
    """Check that NaN and infinities in the rendered picture or the photo are refused."""
    problems = []
    for bad in (math.nan, math.inf, -math.inf):
        for index in (0, 1):
            pair = [_noise(0), _noise(1)]
            pair[index][5, 6, 1] = bad
            try:
                photometric_loss(*pair, threads=1)
                problems.append(f"{bad} in the {('picture', 'photo')[index]} is not refused")
            except NumericalError:
                continue
    return Finding("refused", problems=tuple(problems))


def refuses_huge_photo(bounds: Bounds) -> Finding:
    """Check that a photo with values outside of [0, 1] is refused: 0 to 255, or 1e4 with variations of 1."""
    problems = []
    for image, target in ((_noise(0), 255.0 * _noise(1)), (1e4 + _noise(0), 1e4 + _noise(1))):
        try:
            photometric_loss(image, target, threads=1)
            problems.append(f"a photo that reaches {float(target.max()):.0f} is not refused")
        except NumericalError:
            continue
    return Finding("refused", problems=tuple(problems))
