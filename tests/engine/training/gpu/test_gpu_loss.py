"""The loss on the card has the value and the gradient of the processor's, for any picture that training may render."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from engine.core.errors import NumericalError
from engine.rasterizer.gpu import FrameSize, Gpu
from engine.rasterizer.gpu.workspace import STORAGE
from engine.training import Target, photometric_loss
from engine.training.gpu import GpuParameters
from engine.training.gpu.training_frame import PhotoLoss, TrainingFrame
from engine.training.losses import GpuExposures
from engine.training.parameters import Parameters as CpuParameters

from ...rasterizer.scenes import camera
from .test_gpu_training import arrays, photo, start


def gpu_loss(
    gpu: Gpu, image: np.ndarray, pixels: np.ndarray, valid: np.ndarray, lambda_dssim: float
) -> tuple[float, np.ndarray, int]:
    """Return the loss of an image, its gradient and the flags of values that are not finite."""
    height, width = pixels.shape[:2]
    parameters: CpuParameters = start(10)
    status = gpu.device.create_buffer(size=64, usage=STORAGE)
    size, exposures = FrameSize(10, 16, 0, width, height, 1000), GpuExposures(gpu, np.zeros((1, 3), np.float32))
    frame = TrainingFrame(gpu, size, GpuParameters(gpu, arrays(parameters)), exposures, status, {})
    packed = np.ascontiguousarray(np.dstack([pixels, np.where(valid, 255, 0).astype(np.uint8)]))
    buffer = gpu.device.create_buffer_with_data(data=packed, usage=STORAGE)
    frame.set_photo(PhotoLoss(buffer, int(valid.sum()), lambda_dssim))
    frame.write("photo", packed)
    frame.write("image", image)
    frame.write("counts", np.zeros(4, np.uint32))
    frame._submit(frame._loss, [])
    gradient = frame.read("gradient", (height, width, 4))
    assert not gradient[..., 3].any()
    return float(frame.read("loss_values", (1,))[0]), gradient[..., :3], frame.counts().not_finite


def cpu_loss(image: np.ndarray, pixels: np.ndarray, valid: np.ndarray, lambda_dssim: float) -> tuple[float, np.ndarray]:
    leaf = torch.from_numpy(image).requires_grad_()
    loss = photometric_loss(leaf, Target(pixels, valid=valid), lambda_dssim=lambda_dssim)
    loss.backward()
    assert leaf.grad is not None
    return loss.item(), leaf.grad.numpy()


@pytest.mark.parametrize(
    ("width", "height", "lambda_dssim", "masked"),
    [(1, 1, 0.2, False), (5, 40, 0.2, False), (81, 50, 0.2, True), (33, 17, 0.0, True), (64, 48, 1.0, False)],
)
def test_loss_and_gradient_are_those_of_the_processor(
    width: int, height: int, lambda_dssim: float, masked: bool, opened_gpu: Gpu
) -> None:
    rng = np.random.default_rng(width)
    pixels = photo(camera(width, height), width)
    image = (pixels / 255.0 + 0.1 * rng.normal(size=pixels.shape)).astype(np.float32)
    image[: height // 3] = pixels[: height // 3].astype(np.float32) * np.float32(1 / 255)  # |x - y| has no slope here
    valid = rng.uniform(size=(height, width)) > 0.2 if masked else np.ones((height, width), bool)
    loss, gradient, flags = gpu_loss(opened_gpu, image, pixels, valid, lambda_dssim)
    expected, slope = cpu_loss(image, pixels, valid, lambda_dssim)
    assert loss == pytest.approx(expected, rel=1e-6) and flags == 0
    difference = np.abs(gradient - slope) / np.abs(slope).max()
    # Both are float32. SSIM divides by variances, which are differences of squares, so rounding reaches 1e-5 at places.
    assert np.quantile(difference, 0.5) <= 1e-6 and difference.max() <= 1e-4
    assert not gradient[~valid].any()


@pytest.mark.gpu
def test_loss_on_a_card_is_that_of_the_processor(opened_gpu: Gpu) -> None:
    test_loss_and_gradient_are_those_of_the_processor(1920, 1080, 0.2, True, opened_gpu)


@pytest.mark.parametrize("scale", [0.0, 2.0, 30.0])
def test_flat_and_bright_pictures_stay_as_exact_as_on_the_processor(scale: float, opened_gpu: Gpu) -> None:
    pixels, valid = np.full((40, 40, 3), 200, np.uint8), np.ones((40, 40), bool)
    image = np.full((40, 40, 3), scale, np.float32)
    loss, gradient, _ = gpu_loss(opened_gpu, image, pixels, valid, 0.2)
    expected, slope = cpu_loss(image, pixels, valid, 0.2)
    assert loss == pytest.approx(expected, rel=1e-3)
    assert np.abs(gradient - slope).max() <= 1e-2 * np.abs(slope).max()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_picture_that_is_not_finite_is_told_unless_the_pixel_does_not_count(value: float, opened_gpu: Gpu) -> None:
    pixels, valid = photo(camera(40, 30)), np.ones((30, 40), bool)
    image = np.full((30, 40, 3), 0.5, np.float32)
    image[12, 20, 1] = value
    assert gpu_loss(opened_gpu, image, pixels, valid, 0.2)[2] & 4  # beside the flag of the gradient
    with pytest.raises(NumericalError, match="the rendered image is not finite"):
        cpu_loss(image, pixels, valid, 0.2)
    valid[12, 20] = False
    loss, gradient, flags = gpu_loss(opened_gpu, image, pixels, valid, 0.2)
    assert flags == 0 and np.isfinite(gradient).all() and np.isfinite(loss)
