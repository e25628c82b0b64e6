"""The loss of a rendered image against a photo, (1 - lambda) L1 + lambda (1 - SSIM), with its gradient, on the CPU."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.autograd.function import once_differentiable

from ...core.arrays import Float32
from ...core.errors import NumericalError
from ...rasterizer import Share, run_shared
from ..settings import LAMBDA_DSSIM
from .photometric_kernels import (
    STRIP,
    blur_target,
    difference_gradient,
    fill_planes,
    plane_layout,
    similarity_and_maps,
)

TARGET_MAX = 2.0
"""Largest absolute value of a target. Values of a photo are in [0, 1]. The variances of SSIM are differences of
squares: where image and photo both exceed 30, float32 does not resolve them beside C2 = 0.0009, and SSIM leaves
[-1, 1]."""

_scratch = threading.local()


class Target:
    """A photo prepared for the loss: its planes and their blurs, which are the same in every training step.

    It takes 36 bytes per pixel. Keep one per view if memory allows; creating it in each step takes a quarter longer.

    Parameters
    ----------
    pixels : uint8 or float32 tensor or array of shape [H, W, 3]
        uint8 is divided by 255. float32 is in [0, 1]; values up to `TARGET_MAX` are accepted, for rendered images.
    valid : bool tensor or array of shape [H, W], optional
        Pixels that count; all by default. The others are black in both images and have no gradient.
    threads : int, optional
        All usable cores by default.

    Raises
    ------
    NumericalError
        If a value is not finite or above `TARGET_MAX`.
    ValueError
        If a shape is wrong, or no pixel is valid.
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
            raise NumericalError("`target` of the loss is not finite; check the photo that it was read from.")
        if (largest := float(np.abs(values).max(initial=0.0))) > TARGET_MAX:
            raise NumericalError(f"`target` of the loss reaches {largest:.4g}, not 1; divide by the photo's white.")
        self.height, self.width = values.shape[:2]
        self.weights = _pixel_weights(self.height, self.width, valid)
        size = 3 * plane_layout(self.height, self.width)[2]
        self.planes, self.means, self.variances = (np.zeros(size, np.float32) for _ in range(3))
        flat = values.reshape(-1)

        def fill(share: Share) -> None:
            fill_planes(share, flat, 3, self.weights, self.height, self.width, self.planes)

        def blur(share: Share) -> None:
            blur_target(share, self.planes, self.height, self.width, self.means, self.variances)

        run_shared(fill, threads)
        run_shared(blur, threads)


def _pixel_weights(height: int, width: int, valid: torch.Tensor | NDArray[np.bool_] | None) -> Float32:
    """Return the weights of pixels, flat [H, W rounded up to 16]: 1 / (3 n_valid) for valid pixels, 0 elsewhere."""
    weights = np.zeros((height, plane_layout(height, width)[0]), np.float32)
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
    """Return this thread's scratch memory for the image's planes [size] and the three maps [3 size]; it is reused."""
    if getattr(_scratch, "image", None) is None or len(_scratch.image) < size:
        _scratch.image = np.empty(size, np.float32)
        _scratch.maps = np.empty(3 * size, np.float32)
    return _scratch.image, _scratch.maps


def _compare(
    image: torch.Tensor, target: Target, lambda_dssim: float, with_gradient: bool, threads: int | None
) -> tuple[float, float, torch.Tensor | None]:
    """Return SSIM, mean |x - y| and, with `with_gradient`, the gradient [H, W, 3] of the loss."""
    height, width = target.height, target.width
    size = 3 * plane_layout(height, width)[2]
    planes, maps = _scratch_planes(size)
    values = image.detach()
    if values.stride(2) != 1 or values.stride(0) != width * values.stride(1):
        values = values.contiguous()
    # A slice of an image with more channels is read in place: its pixels are `pixel_step` floats apart.
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
            "the rendered image is not finite at a pixel that is compared with the photo; "
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
    """The loss as an autograd function. The gradient is computed with the value, and scaled in the backward pass."""

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


def _check_target(image: torch.Tensor, target: torch.Tensor | Target, valid: Any, threads: int | None) -> Target:
    """Return `target` as a `Target`; raise ValueError if it does not match `image`."""
    prepared = target if isinstance(target, Target) else Target(target.detach(), valid=valid, threads=threads)
    if isinstance(target, Target) and valid is not None:
        raise ValueError("`valid` belongs to the `Target` when one is given")
    if tuple(image.shape) != (prepared.height, prepared.width, 3):
        raise ValueError(
            f"image {tuple(image.shape)} and target {(prepared.height, prepared.width, 3)} differ in shape"
        )
    if image.dtype != torch.float32 or image.device.type != "cpu":
        raise ValueError(f"the loss takes float32 on the CPU, got {image.dtype} on {image.device}")
    return prepared


def photometric_loss(
    image: torch.Tensor,
    target: torch.Tensor | Target,
    *,
    lambda_dssim: float = LAMBDA_DSSIM,
    valid: torch.Tensor | None = None,
    threads: int | None = None,
) -> torch.Tensor:
    """Return (1 - lambda) mean |x - y| + lambda (1 - mean SSIM), a scalar, differentiable once in `image`.

    SSIM is that of 3D Gaussian splatting: an 11x11 Gaussian window, zero padding, values in [0, 1].

    Parameters
    ----------
    image : float32 tensor of shape [H, W, 3]
        Rendered colours. It may be a slice ``raster.image[..., :3]`` of an image with more channels.
    target : tensor of shape [H, W, 3], uint8 or float32, or `Target`
    lambda_dssim : float
        Weight of the SSIM term, 0 to 1.
    valid : bool tensor of shape [H, W], optional
        Pixels that count, if `target` is a tensor.
    threads : int, optional
        All usable cores by default; the result does not depend on it.

    Raises
    ------
    NumericalError
        If the image or the target is not finite, or the target is above `TARGET_MAX`.
    ValueError
        If shapes or dtypes do not match.

    References
    ----------
    Kerbl et al. 2023, "3D Gaussian Splatting for Real-Time Radiance Field Rendering", eq. 7.
    Wang et al. 2004, "Image Quality Assessment: From Error Visibility to Structural Similarity".
    """
    return _PhotometricLoss.apply(image, _check_target(image, target, valid, threads), lambda_dssim, threads)


def ssim(image: torch.Tensor, target: torch.Tensor | Target, *, valid: torch.Tensor | None = None) -> float:
    """Return the mean SSIM of two images [H, W, 3] with values in [0, 1], as in `photometric_loss`.

    Raises
    ------
    NumericalError
        If the image or the target is not finite, or the target is above `TARGET_MAX`.
    ValueError
        If shapes or dtypes do not match.
    """
    return _compare(image, _check_target(image, target, valid, None), 0.0, False, None)[0]
