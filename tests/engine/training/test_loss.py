"""The fused loss is (1 - lambda) L1 + lambda (1 - SSIM) as torch's convolutions compute it in float64."""

from __future__ import annotations

import pytest
import torch
import torch.nn.functional as functional

from engine.core.errors import NumericalError
from engine.training.losses.photometric import Target, photometric_loss, ssim


def slow_ssim_map(image: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Return the SSIM of each pixel and channel, [1, 3, H, W], of images [H, W, 3]."""
    offsets = torch.arange(11, dtype=torch.float64) - 5
    window = torch.exp(-(offsets**2) / (2 * 1.5**2))
    window = window / window.sum()
    kernel = torch.outer(window, window).expand(3, 1, 11, 11)

    def blur(x: torch.Tensor) -> torch.Tensor:
        return functional.conv2d(x, kernel, padding=5, groups=3)

    x, y = (picture.permute(2, 0, 1)[None] for picture in (image, target))
    a, b = blur(x), blur(y)
    xx, yy, xy = blur(x * x) - a * a, blur(y * y) - b * b, blur(x * y) - a * b
    c1, c2 = 0.01**2, 0.03**2
    return (2 * a * b + c1) * (2 * xy + c2) / ((a * a + b * b + c1) * (xx + yy + c2))


def slow_loss(image: torch.Tensor, target: torch.Tensor, valid: torch.Tensor, weight: float) -> torch.Tensor:
    image, target = image * valid[..., None], target * valid[..., None]
    difference = (image - target).abs()[valid].mean()
    return (1 - weight) * difference + weight * (1 - slow_ssim_map(image, target)[..., valid].mean())


def pictures(height: int, width: int) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(height * 1000 + width)
    return torch.rand(height, width, 3, generator=generator), torch.rand(height, width, 3, generator=generator)


@pytest.mark.parametrize("size", [(1, 1), (17, 33), (64, 48), (71, 5)])
@pytest.mark.parametrize("masked", [False, True])
def test_value_and_gradient_agree_with_convolutions(size: tuple[int, int], masked: bool) -> None:
    image, target = pictures(*size)
    valid = torch.ones(size, dtype=torch.bool)
    if masked:
        valid = torch.rand(size, generator=torch.Generator().manual_seed(1)) > 0.3
        valid[0, 0] = True
    ours = image.clone().requires_grad_()
    loss = photometric_loss(ours, target, valid=valid if masked else None)
    (2.0 * loss).backward()
    truth = image.double().requires_grad_()
    expected = slow_loss(truth, target.double(), valid, 0.2)
    (2.0 * expected).backward()
    assert ours.grad is not None and truth.grad is not None
    assert abs(loss.item() - expected.item()) < 1e-6
    assert float((ours.grad - truth.grad).norm() / truth.grad.norm()) < 1e-5
    assert not ours.grad[~valid].any()


def test_a_target_and_bytes_and_a_slice_of_an_image_with_more_channels_give_the_same_loss() -> None:
    image, _ = pictures(20, 30)
    photo = (torch.rand(20, 30, 3) * 255).to(torch.uint8)
    wide = torch.cat([image, torch.rand(20, 30, 16)], dim=2).requires_grad_()
    plain = photometric_loss(image, photo.float() / 255)
    sliced = photometric_loss(wide[..., :3], Target(photo))
    assert abs(plain.item() - sliced.item()) < 1e-6
    sliced.backward()
    assert wide.grad is not None and wide.grad[..., :3].any() and not wide.grad[..., 3:].any()


def test_ssim_of_an_image_with_itself_is_one_and_agrees_with_convolutions() -> None:
    image, target = pictures(40, 30)
    assert abs(ssim(image, image) - 1.0) < 1e-6
    assert abs(ssim(image, target) - float(slow_ssim_map(image.double(), target.double()).mean())) < 1e-6


def test_the_loss_is_the_same_bit_for_bit_with_any_number_of_threads() -> None:
    image, target = pictures(150, 70)
    found = []
    for threads in (1, 3):
        leaf = image.clone().requires_grad_()
        loss = photometric_loss(leaf, target, threads=threads)
        loss.backward()
        assert leaf.grad is not None
        found.append((loss.detach(), leaf.grad))
    assert torch.equal(found[0][0], found[1][0]) and torch.equal(found[0][1], found[1][1])


def test_images_that_are_not_finite_or_do_not_match_are_refused() -> None:
    image, target = pictures(10, 10)
    with pytest.raises(ValueError, match="shape"):
        photometric_loss(image, target[:9])
    with pytest.raises(ValueError, match="no pixel"):
        photometric_loss(image, target, valid=torch.zeros(10, 10, dtype=torch.bool))
    image[3, 3, 1] = float("nan")
    with pytest.raises(NumericalError, match="rendered image is not finite"):
        photometric_loss(image, target)
    with pytest.raises(NumericalError, match="target"):
        photometric_loss(target, image)
