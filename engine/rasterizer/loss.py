"""The loss of a picture against a photo: (1 - lambda) L1 + lambda (1 - SSIM), with its gradient, on the CPU."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.autograd.function import once_differentiable

from ..errors import NumericalError
from .loss_kernels import (
    BORDER,
    PAD,
    STRIP,
    blur_target,
    difference_gradient,
    fill_planes,
    similarity_and_maps,
)
from .threads import Share, run_shared

__all__ = ["Target", "photometric_loss", "ssim"]

Float32 = NDArray[np.float32]

TARGET_MAX = 2.0
"""Values above this are refused. SSIM's variances are differences of squares: from 30 on, float32 leaves nothing of them
beside C2 = 0.0009 where picture and photo are both that bright, and SSIM leaves [-1, 1]."""

_scratch = threading.local()


class Target:
    """A photo made ready for the loss: its planes, and their blurs, which do not change from step to step.

    Takes 36 bytes a pixel. Keep one per view when memory allows; make a new one each step otherwise (a quarter slower).

    Parameters
    ----------
    pixels : uint8 or float32 tensor or array of shape [H, W, 3]
        uint8 is divided by 255, float32 lies in [0, 1] (values to 2 are taken, for a metric between rendered pictures).
    valid : bool tensor or array of shape [H, W], optional
        Pixels that count; all by default. The others are black in both pictures and have no gradient.
    """

    def __init__(
        self,
        pixels: torch.Tensor | NDArray[Any],
        *,
        valid: torch.Tensor | NDArray[np.bool_] | None = None,
        threads: int | None = None,
    ) -> None:
        values = np.asarray(pixels)
        if values.ndim != 3 or values.shape[2] != 3:
            raise ValueError(f"a target has shape [H, W, 3], got {values.shape}")
        if values.dtype == np.uint8:
            values = values.astype(np.float32) * np.float32(1.0 / 255.0)
        values = np.ascontiguousarray(values, np.float32)
        if not np.isfinite(values).all():
            raise NumericalError("`target` of the loss is not finite; check the photo it was made of.")
        if (largest := float(np.abs(values).max(initial=0.0))) > TARGET_MAX:
            raise NumericalError(f"`target` of the loss reaches {largest:.4g}, not 1; divide by the photo's white.")
        self.height, self.width = values.shape[:2]
        self.weights = _pixel_weights(self.height, self.width, valid)
        size = _plane_length(self.height, self.width) * 3
        self.planes, self.means, self.variances = (np.zeros(size, np.float32) for _ in range(3))
        flat = values.reshape(-1)

        def fill(share: Share) -> None:
            fill_planes(share, flat, 3, self.weights, self.height, self.width, self.planes)

        def blur(share: Share) -> None:
            blur_target(share, self.planes, self.height, self.width, self.means, self.variances)

        run_shared(fill, threads)
        run_shared(blur, threads)


def _plane_length(height: int, width: int) -> int:
    return ((width + 15) // 16 * 16 + 2 * PAD) * (height + 2 * BORDER)


def _pixel_weights(height: int, width: int, valid: torch.Tensor | NDArray[np.bool_] | None) -> Float32:
    """Return flat [H, W rounded up to 16]: 1 / (3 n_valid) for each pixel that counts, 0 elsewhere."""
    weights = np.zeros((height, (width + 15) // 16 * 16), np.float32)
    if valid is None:
        weights[:, :width] = 1.0 / (3 * height * width)
        return weights.reshape(-1)
    counts = np.asarray(valid, dtype=bool)
    if counts.shape != (height, width):
        raise ValueError(f"`valid` must have shape {(height, width)}, got {counts.shape}")
    n_valid = int(counts.sum())
    if n_valid == 0:
        raise ValueError("`valid` leaves no pixel for the loss")
    weights[:, :width][counts] = 1.0 / (3 * n_valid)
    return weights.reshape(-1)


def _scratch_planes(size: int) -> tuple[Float32, Float32]:
    """Return this thread's room for the picture's planes [size] and the three maps [3 size]; it is kept and grows."""
    if getattr(_scratch, "image", None) is None or len(_scratch.image) < size:
        _scratch.image = np.empty(size, np.float32)
        _scratch.maps = np.empty(3 * size, np.float32)
    return _scratch.image, _scratch.maps


def _compare(
    image: torch.Tensor, target: Target, lambda_dssim: float, with_gradient: bool, threads: int | None
) -> tuple[float, float, torch.Tensor | None]:
    """Return SSIM, mean |x - y| and, if asked, the gradient [H, W, 3] of the loss."""
    height, width = target.height, target.width
    size = _plane_length(height, width) * 3
    planes, maps = _scratch_planes(size)
    values = image.detach()
    if values.stride(2) != 1 or values.stride(0) != width * values.stride(1):
        values = values.contiguous()
    # A slice of a wider picture is read in place: pixels lie `pixel_step` floats apart.
    pixel_step = values.stride(1)
    flat = values.as_strided(((height * width - 1) * pixel_step + 3,), (1,)).numpy()
    n_strips = (height + STRIP - 1) // STRIP
    totals = np.zeros((3 * n_strips, 2))

    def fill(share: Share) -> None:
        fill_planes(share, flat, pixel_step, target.weights, height, width, planes)

    def compare(share: Share) -> None:
        similarity_and_maps(
            share, planes, target.planes, target.means, target.variances, target.weights, height, width, maps, totals
        )

    run_shared(fill, threads)
    run_shared(compare, threads)
    similarity, difference = (float(total) for total in totals.sum(axis=0))
    if not np.isfinite(similarity + difference):
        raise NumericalError(
            "the rendered picture is not finite where it meets the photo; "
            "lower the learning rate or resume from the last checkpoint."
        )
    if not with_gradient:
        return similarity, difference, None
    gradient = np.empty((height, width, 3), np.float32)
    flat_gradient = gradient.reshape(-1)

    def differentiate(share: Share) -> None:
        difference_gradient(
            share, planes, target.planes, target.weights, maps, height, width, -lambda_dssim, 1.0 - lambda_dssim,
            flat_gradient,
        )  # fmt: skip

    run_shared(differentiate, threads)
    return similarity, difference, torch.from_numpy(gradient)


class _PhotometricLoss(torch.autograd.Function):
    """The gradient is computed with the value, then only scaled."""

    @staticmethod
    def forward(
        ctx: Any, image: torch.Tensor, target: Target, lambda_dssim: float, threads: int | None
    ) -> torch.Tensor:
        similarity, difference, gradient = _compare(image, target, lambda_dssim, image.requires_grad, threads)
        ctx.gradient = gradient
        return image.new_tensor((1.0 - lambda_dssim) * difference + lambda_dssim * (1.0 - similarity))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, upstream: torch.Tensor) -> Any:  # type: ignore[override]
        factor = np.float32(upstream.item())
        gradient = ctx.gradient if factor == 1.0 else torch.from_numpy(ctx.gradient.numpy() * factor)
        return gradient, None, None, None


def _checked(image: torch.Tensor, target: torch.Tensor | Target, valid: Any, threads: int | None) -> Target:
    ready = target if isinstance(target, Target) else Target(target.detach(), valid=valid, threads=threads)
    if isinstance(target, Target) and valid is not None:
        raise ValueError("`valid` belongs to the `Target` when one is given")
    if tuple(image.shape) != (ready.height, ready.width, 3):
        raise ValueError(f"image {tuple(image.shape)} and target {(ready.height, ready.width, 3)} differ in shape")
    if image.dtype != torch.float32 or image.device.type != "cpu":
        raise ValueError(f"the loss takes float32 on the CPU, got {image.dtype} on {image.device}")
    return ready


def photometric_loss(
    image: torch.Tensor,
    target: torch.Tensor | Target,
    *,
    lambda_dssim: float = 0.2,
    valid: torch.Tensor | None = None,
    threads: int | None = None,
) -> torch.Tensor:
    """Return (1 - lambda) mean |x - y| + lambda (1 - mean SSIM), a scalar, differentiable in `image` (once).

    SSIM as in 3D Gaussian splatting: 11x11 Gaussian window, zero padding, values in [0, 1].

    Parameters
    ----------
    image : float32 tensor of shape [H, W, 3]
        May be a slice ``raster.image[..., :3]`` of a wider picture.
    target : tensor of shape [H, W, 3], uint8 or float32, or `Target`
    lambda_dssim : float
    valid : bool tensor of shape [H, W], optional
        Pixels that count, when `target` is a tensor.
    threads : int, optional
        All usable cores by default; the result does not depend on it.

    Raises
    ------
    NumericalError
        When either picture is not finite, or the target far above 1.
    """
    return _PhotometricLoss.apply(image, _checked(image, target, valid, threads), lambda_dssim, threads)


def ssim(image: torch.Tensor, target: torch.Tensor | Target, *, valid: torch.Tensor | None = None) -> float:
    """Return the mean SSIM of two pictures [H, W, 3] with values in [0, 1], as in `photometric_loss`."""
    return _compare(image, _checked(image, target, valid, None), 0.0, False, None)[0]
